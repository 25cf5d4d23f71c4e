"""The store: nothing lost, nothing doubled, round trips exact, and every broken file met with a remedy."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softlab.bench.store.database import Store
from softlab.bench.store.results import Timing, configuration, machines, measures, open_readonly, timings
from softlab.bench.store.schema import TABLES, canonical, configuration_hash
from softlab.bench.store.text import flatten, unflatten
from softlab.bench.store.transfer import export, load_text, merge
from softlab.model.base.errors import InputError
from softlab.model.scene.scene import Scene, load_scene

RECORD = {"cpu": "Some CPU", "cores": 2, "caches": {"L2": 1 << 20}, "gpu": None, "copy_bandwidth": 2.0e10 / 3}


def scene(n: int = 8) -> Scene:
    return load_scene("lab-grid").replace({"grid.rows": n, "grid.columns": n})


def describe(n: int = 8, **options: Any) -> dict[str, Any]:
    options.setdefault("threads", 2)
    return configuration(scene(n), backend="cpu", layer="omp", wait_policy="default", **options)


def filled(path: str | Path = ":memory:", key: str = "m1") -> Store:
    """A store of one machine and run, two configurations, a few samples and measures."""
    store = Store(path)
    store.add_machine(key, "Some CPU, 2 cores; no GPU", RECORD)
    run = store.start_run(key, "softlab sweep --quick", "abc123+")
    for n in (8, 16):
        store.add_measure(run, describe(n), "s1", "error", 1e-6 / 3, "spacing", "against NumPy")
        for seconds in (0.1, 0.3, 0.2 / 3):
            store.add_sample(run, describe(n), "s1", seconds, 10, suspect="sample under 1 ms" if n == 8 else None)
    store.add_measure(run, describe(8), "s1", "difference", None, "spacing", "no GPU, so no comparison")
    store.add_measure(run, describe(16), "s1", "growth", math.inf, "", None)
    return store


def content(store: Store) -> dict[str, list[tuple[Any, ...]]]:
    return {
        table: sorted(store.query(f"SELECT {', '.join(columns)} FROM {table}"), key=repr)
        for table, columns in TABLES.items()
    }


def test_repeats_are_counted_over_runs_of_the_same_machine_and_sources() -> None:
    with filled() as store:
        other_run = store.start_run("m1", "again")
        assert store.add_sample(other_run, describe(8), "s1", 0.1, 10) == 3
        assert store.add_sample(other_run, describe(8), "s2", 0.1, 10) == 0, "changed sources are measured anew"
        assert store.add_sample(other_run, describe(8), "s1", 0.1, 10, stage="compile") == 0
        store.add_machine("m2", "Another", {})
        assert store.add_sample(store.start_run("m2", "x"), describe(8), "s1", 0.1, 10) == 0
        assert store.sample_count(describe(8), "m1", "s1") == 4
        assert store.sample_count(describe(9), "m1", "s1") == 0
        assert store.has_measure(describe(8), "m1", "s1", "error")
        assert not store.has_measure(describe(8), "m1", "s2", "error")


def test_timings_summarise_the_newest_sources() -> None:
    with filled() as store:
        small, large = timings(store)
        assert (small.rows, large.rows, large.particles) == (8, 16, 256)
        assert large.seconds_per_step == pytest.approx([0.01, 0.03, 0.02 / 3])
        assert (large.median, large.low, large.high) == pytest.approx((0.01, 0.02 / 3, 0.03))
        assert large.thread_word == "1x" and large.threads == 2 and large.integrator == "lab"
        assert large.error == 1e-6 / 3 and large.error_reason == "against NumPy"
        assert large.bytes_per_step == 32 * 256
        assert small.suspect[0] == "sample under 1 ms" and small.suspect[1].startswith("spread")
        run = store.start_run("m1", "newer")
        store.add_sample(run, describe(16), "s2", 0.5, 10)
        newest = timings(store)[1]
        assert newest.seconds_per_step == [0.05] and newest.sources == "s2"
        assert newest.error is None and newest.error_reason == "not checked with these sources"


def test_measures_keep_missing_and_infinite_values_with_their_reasons() -> None:
    with filled() as store:
        found = {(m.description["scene"]["grid"]["rows"], m.name): m for m in measures(store)}
        assert found[8, "difference"].value is None and found[8, "difference"].reason == "no GPU, so no comparison"
        assert found[16, "growth"].value == math.inf
        assert {m.name for m in measures(store, name="error")} == {"error"}
        with pytest.raises(ValueError, match="reason"):
            store.add_measure(found[8, "error"].run, describe(), "s1", "error", math.nan)


def test_a_machine_only_gains_what_was_not_known() -> None:
    with filled() as store:
        store.add_machine("m1", "renamed", RECORD | {"gpu": "H200", "cores": 99})
        (machine,) = machines(store)
        assert machine.label.startswith("Some CPU") and machine.record["cores"] == 2 and machine.record["gpu"] == "H200"


def test_limits_measured_undisturbed_take_the_place_of_disturbed_ones() -> None:
    disturbed = RECORD | {"limits_suspect": "load: other programs ran", "gpu_copy_bandwidth": 3.0e12}
    clean = RECORD | {"limits_suspect": None, "copy_bandwidth": 4.0e10}
    with Store(":memory:") as store:
        store.add_machine("m1", "Some CPU", disturbed)
        for record, copied in (
            (clean, 2.0e10 / 3),
            (clean | {"gpu_copy_bandwidth": 3.1e12}, 4.0e10),
            (disturbed, 4.0e10),
        ):
            store.add_machine("m1", "Some CPU", record)  # the first lacks one of what was disturbed
            assert machines(store)[0].record["copy_bandwidth"] == copied
        held = machines(store)[0].record
        assert held["limits_suspect"] is None and held["gpu_copy_bandwidth"] == 3.1e12 and held["cores"] == 2


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".sqlite"])
def test_export_and_merge_round_trip_exactly_and_twice_adds_nothing(tmp_path: Path, suffix: str) -> None:
    with filled(tmp_path / "results.sqlite") as store, Store(tmp_path / "new.sqlite") as new:
        file = export(store, tmp_path / f"out{suffix}")
        assert sum(merge(new, file).values()) > 0
        assert content(new) == content(store)
        assert not any(merge(new, file).values())
        assert not any(merge(store, file).values())
        assert content(new) == content(store)
        with open_readonly(file) as read:
            assert timings(read) == timings(store)
    assert sorted(p.name for p in tmp_path.iterdir() if "part" in p.name) == []


def test_a_text_export_is_repeatable_and_of_one_machine_when_asked(tmp_path: Path) -> None:
    with filled() as store:
        store.add_machine("m2", "Another", {})
        store.add_sample(store.start_run("m2", "x"), describe(64), "s1", 0.1, 10)
        first = export(store, tmp_path / "a.csv").read_bytes()
        assert export(store, tmp_path / "a.csv").read_bytes() == first, "an earlier text export is replaced"
        one = export(store, tmp_path / "m2.csv", machine="m2")
        two = export(store, tmp_path / "m1.csv", machine="m1")
        with load_text([one]) as read:
            assert [t.rows for t in timings(read)] == [64] and [m.key for m in machines(read)] == ["m2"]
        with load_text([two, one]) as both:
            assert content(both) == content(store)
        with pytest.raises(InputError, match="knows no machine"):
            export(store, tmp_path / "m3.csv", machine="m3")


names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=8)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3),
    max_leaves=8,
)


@settings(deadline=None)
@given(st.dictionaries(names.filter(lambda name: "." not in name), values, max_size=5))
def test_any_description_survives_being_spread_over_columns(data: dict[str, Any]) -> None:
    assert canonical(unflatten(flatten(data))) == canonical(data)


@pytest.mark.parametrize("depth", [1, 40, 900])
def test_tables_however_deep_are_spread_over_columns(depth: int) -> None:
    data: dict[str, Any] = {"a": 1}
    for _ in range(depth):
        data = {"a": data}
    assert unflatten(flatten(data)) == data


text = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
finite = st.floats(min_value=0, allow_nan=False, allow_infinity=False)


@settings(deadline=None, max_examples=40)
@given(
    samples=st.lists(
        st.tuples(finite, st.integers(0, 10**9), st.none() | finite, text, st.sampled_from("abc")), max_size=6
    ),
    numbers=st.lists(st.tuples(names, st.none() | st.floats(), text, text), max_size=4),
    command=text,
    peer=values,
)
def test_any_store_survives_its_text_export(
    tmp_path_factory: pytest.TempPathFactory, samples: list[Any], numbers: list[Any], command: str, peer: Any
) -> None:
    with filled() as store:
        run = store.start_run("m1", command)
        for seconds, steps, joules, suspect, stage in samples:
            store.add_sample(
                run, describe(32, peer=peer), "s", seconds, steps, joules=joules, suspect=suspect, stage=stage
            )
        for name, value, unit, reason in numbers:
            store.add_measure(run, describe(32), "s", name.replace("\0", "0"), value, unit, reason or "why")
        file = export(store, tmp_path_factory.mktemp("text") / "out.csv")
        with load_text([file]) as read:
            assert content(read) == content(store)


def timed(*seconds: float, stage: str = "step") -> Timing:
    """The timing that these samples of one step add up to."""
    with Store(":memory:") as store:
        store.add_machine("m1", "Some CPU", RECORD)
        run = store.start_run("m1", "softlab sweep")
        for one in seconds:
            store.add_sample(run, describe(), "s1", one, 1, stage=stage)
        (found,) = timings(store, stage=stage)
    return found


@pytest.mark.parametrize(
    ("spread", "suspect"), [(0.0, ()), (0.09, ()), (0.11, ("spread 11%",)), (0.4, ("spread 40%",))]
)
def test_a_spread_over_a_tenth_is_suspect(spread: float, suspect: tuple[str, ...]) -> None:
    """Of five repeats the quartiles are the second and the fourth."""
    found = timed(1 - spread / 2, 1 - spread / 2, 1.0, 1 + spread / 2, 1 + spread / 2)
    assert found.spread == pytest.approx(spread) and found.suspect == suspect


def test_disturbed_samples_do_not_count_beside_three_others() -> None:
    with Store(":memory:") as store:
        store.add_machine("m", "A machine", RECORD)
        run = store.start_run("m", "softlab sweep")
        for n, clean in ((8, 2), (16, 3)):
            for seconds in (1.0,) * clean:
                store.add_sample(run, describe(n), "s", seconds, 10)
            store.add_sample(run, describe(n), "s", 9.0, 10, suspect="load: busy")
        few, enough = timings(store)
    assert (few.count, few.high, few.suspect[0]) == (3, 0.9, "load: busy")
    assert (enough.count, enough.high, enough.suspect) == (3, 0.1, ())


def test_one_repeat_that_was_disturbed_is_in_the_extremes_and_not_in_the_spread() -> None:
    found = timed(1.0, 1.01, 1.02, 1.03, 50.0)
    assert (found.low, found.median, found.high) == (1.0, 1.02, 50.0)
    assert found.spread == pytest.approx(0.02 / 1.02) and found.suspect == ()


def test_compiling_is_done_once_and_has_no_spread_to_suspect() -> None:
    assert timed(1.0, 2.0, 3.0, stage="compile").suspect == ()


def test_what_another_machine_or_other_sources_measured_is_not_held() -> None:
    with filled() as store:
        store.add_machine("m2", "Another", {})
        run = store.start_run("m2", "softlab sweep")
        store.add_measure(run, describe(32), "s1", "error", 0.5, "spacing")
        store.add_sample(run, describe(32), "s1", 0.1, 10)
        assert (
            store.has_measure(describe(32), "m2", "s1", "error") and store.sample_count(describe(32), "m2", "s1") == 1
        )
        for machine, sources, name in (("m1", "s1", "error"), ("m2", "s2", "error"), ("m2", "s1", "drift")):
            assert not store.has_measure(describe(32), machine, sources, name), (machine, sources, name)
        assert store.sample_count(describe(32), "m1", "s1") == store.sample_count(describe(32), "m2", "s2") == 0
        assert store.sample_count(describe(32), "m2", "s1", "compile") == 0
        assert [m.value for m in measures(store, "error", "m2")] == [0.5]
        assert {t.machine for t in timings(store, "m2")} == {"m2"} and len(timings(store, "m1")) == 2


def test_configurations_are_named_by_their_content() -> None:
    first, second = describe(8), json.loads(json.dumps(describe(8)))
    assert configuration_hash(first) == configuration_hash(dict(reversed(second.items())))
    assert configuration_hash(first) != configuration_hash(describe(8, graphics=True))
