"""Whether two times differ: the rule of labs' sentences, on times made up."""

from __future__ import annotations

import pytest

from softlab.bench.store.results import Timing
from softlab.plots.core.apart import apart, ratio_interval, too_few


def timed(*times: float, sessions: int = 1) -> Timing:
    nothing = dict.fromkeys(Timing.__dataclass_fields__)
    known = {
        "seconds_per_step": list(times), "median": sorted(times)[len(times) // 2], "low": min(times), "high": max(times),
        "count": len(times), "sessions": sessions,
    }  # fmt: skip
    return Timing(**nothing | known)  # type: ignore[arg-type]


def test_five_repeats_are_apart_when_none_lies_among_the_others() -> None:
    quick, slow = timed(1.0, 1.01, 1.02, 1.03, 1.04), timed(1.3, 1.31, 1.32, 1.33, 1.34)
    assert (apart(quick, slow), apart(slow, quick), apart(quick, quick)) == (-1, 1, 0)
    assert apart(quick, timed(1.035, 1.31, 1.32, 1.33, 1.34)) == 0


def test_three_repeats_must_be_further_apart() -> None:
    """Complete separation of three and three is chance once in ten; three ranges apart is not."""
    base = timed(1.0, 1.1, 1.2)
    assert apart(base, timed(1.3, 1.4, 1.5)) == 0 and too_few(base, timed(1.3, 1.4, 1.5))
    assert not too_few(base, timed(1.15, 1.4, 1.5)), "these meet: no difference was seen"
    assert not too_few(base, timed(1.9, 2.0, 2.1)), "decided"
    assert apart(base, timed(1.9, 2.0, 2.1)) == -1


def test_a_disturbed_repeat_hides_no_hundredfold_difference() -> None:
    """One of three took twice as long: of a time a hundred times as large that is a hundred times as many seconds."""
    quick, slow = timed(1.0, 1.5, 1.8), timed(200.0, 210.0, 400.0)
    assert (apart(quick, slow), apart(slow, quick)) == (-1, 1)


def test_one_session_does_not_bear_a_small_difference() -> None:
    first, second = (timed(*(t * k for k in (0.999, 1.0, 1.0, 1.0, 1.001)), sessions=2) for t in (1.0, 1.1))
    assert apart(first, second) == -1
    assert apart(first, timed(*second.seconds_per_step)) == 0
    assert apart(first, timed(*(1.06 * t for t in second.seconds_per_step))) == -1


@pytest.mark.parametrize(("outlier", "told"), [(1.0, -1), (5.0, -1)])
def test_of_many_repeats_one_that_was_disturbed_decides_nothing(outlier: float, told: int) -> None:
    quick = timed(1.0, 1.01, 1.02, 1.0, 1.01, 1.02, 1.0, 1.01, outlier)
    assert apart(quick, timed(*(1.5 * t for t in (1.0, 1.01, 1.02, 1.0, 1.01, 1.02, 1.0, 1.01, 1.0)))) == told


def test_the_interval_holds_the_ratio_and_narrows_with_repeats() -> None:
    noisy = [1.0, 1.2, 0.9, 1.1, 1.05, 0.95, 1.15]
    low, high = ratio_interval(tuple(noisy), tuple(2 * t for t in noisy))
    assert low < 0.5 < high
    many = ratio_interval(tuple(noisy * 6), tuple(2 * t for t in noisy * 6))
    assert many[1] - many[0] < high - low
