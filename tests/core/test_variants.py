"""What runs by default of a test with many variants."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from variants import covering, shown

TABLE = {"solver": ("cpu", "gpu", "reference"), "real": ("float32", "float64"), "dt": (1, 2, 3), "kernel": ("a", "b")}
ALL = [dict(zip(TABLE, values, strict=True)) for values in itertools.product(*TABLE.values())]


@pytest.mark.parametrize(("together", "least"), [(1, 3), (2, 9), (3, 18), (4, 36)])
def test_every_value_and_every_pair_is_among_the_chosen(together, least):
    """At least as many as the largest tables of `together` parameters multiply to, and not many more."""
    chosen = covering(ALL, together)
    assert set().union(*(shown(ALL[k], together) for k in chosen)) == set().union(*(shown(c, together) for c in ALL))
    assert least <= len(chosen) <= 1.5 * least


cases = st.lists(st.dictionaries(st.sampled_from("abcd"), st.integers(0, 3), min_size=1), min_size=1, max_size=30)


@settings(deadline=None, max_examples=50)
@given(cases, st.integers(1, 3))
def test_of_any_cases_nothing_is_left_out_and_nothing_chosen_for_nothing(cases, together):
    chosen = covering(cases, together)
    assert chosen == sorted(set(chosen)) == covering([dict(case) for case in cases], together)
    assert set().union(*(shown(cases[k], together) for k in chosen)) == set().union(
        *(shown(case, together) for case in cases)
    )
    assert len(chosen) <= len({item for case in cases for item in shown(case, together)})


def test_values_that_come_alone_do_not_bring_the_others_again():
    assert covering([{"a": 1, "b": 1}, {"a": 1, "b": 2}, {"a": 2, "b": 3}, {"a": 2, "b": 2}]) == [0, 1, 2]
    assert covering([{"a": 1}]) == [0] and covering([]) == []


def test_what_others_show_is_not_shown_again():
    """Every pair is shown, by the known cases or by the chosen ones; none of these shows only known pairs."""
    known = ALL[::5]
    chosen = covering(ALL, 2, known)
    pairs = [shown(ALL[k], 2) for k in chosen]
    assert set().union(*pairs, *(shown(case, 2) for case in known)) == set().union(*(shown(case, 2) for case in ALL))
    assert all(new - set().union(*(shown(case, 2) for case in known)) for new in pairs)
    assert covering(ALL, 2, ALL) == []
