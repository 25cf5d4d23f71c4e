"""The first page of the lab book: the fastest way to each error, from made-up runs."""

from __future__ import annotations

from dataclasses import replace

from synthetic_store import CPU_RECORD, GPU_RECORD, Maker

from softlab.bench.experiments.accuracy.experiment import STAGE
from softlab.bench.experiments.accuracy.points import SUSPECT_NOTE, AccuracySummary
from softlab.bench.measure import words
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.labbook.answer import DASH, HEAD, SUSPECT, winner_tables
from softlab.labbook.claims import accuracy, comparison
from softlab.model.scene.scene import load_scene
from softlab.plots.core.accuracy_points import points, reaching
from softlab.plots.core.data import Results
from softlab.plots.core.read import load


def made(record: dict, *runs: tuple[str, float, float, float | None, str], unresolved: tuple[str, ...] = ()) -> Results:
    """Runs of S1 in float32: (integrator, dt, error, cost, backend); `unresolved`: integrators with unresolved errors."""
    store = Store(":memory:")
    maker = Maker(store, record, "m")
    for integrator, dt, error, cost, backend in runs:
        known = float(integrator in unresolved)
        maker.point("lab-curtain", integrator, dt, error, cost, None, "float32", backend, unresolved=known)
    return load(store)


def test_the_fastest_of_those_that_reach_the_error_and_its_limit() -> None:
    results = made(
        GPU_RECORD,
        ("rk4", 0.01, 5e-4, 3e-3, "cpu"), ("rk4", 0.02, float("inf"), 1e-3, "cpu"), ("lab", 0.02, 0.05, 1e-4, "gpu"),
        ("velocity-verlet", 0.01, 5e-3, 2e-4, "gpu"),
    )  # fmt: skip
    (table,) = winner_tables(results)
    assert table["title"].endswith("GPU Made-up GPU, CPU Made-up CPU, 16 cores")
    tenth, finer, thousandth, finest = (dict(zip(HEAD, row, strict=True)) for row in table["rows"])
    assert tenth["Error at most"] == "0.1" and tenth["Masses"] == "1024" and finer["Scene"] == finer["Masses"] == ""
    assert (tenth["Method"], tenth["Step"], tenth["Processor"]) == ("lab", f"20{words.SPACE}ms", "GPU, float32")
    assert tenth["Error"] == "0.050" and tenth["Tie"] == DASH
    assert tenth["Simulated second"] == f"100{words.SPACE}µs"
    assert tenth["One run"] == f"170{words.SPACE}µs"  # 1.5 simulated seconds and the copy
    assert tenth["Limit"] == f"31.2{words.SPACE}ms, 1.6{words.TIMES}"  # 1/32 s: docs/method/index.md
    assert finer["Error at most"] == "0.03, 0.01" and finer["Method"] == "velocity-verlet"
    assert thousandth["Error at most"] == "0.003, 0.001" and thousandth["Method"] == "rk4"
    assert finest["Method"].startswith("not reached; least 5.0")


def test_within_the_rule_the_more_accurate_run_wins_and_the_tie_is_named() -> None:
    """5 % faster at five times the error is a tie; 30 % faster is none; an error that is not resolved wins nothing."""
    results = made(
        CPU_RECORD, ("lab", 0.02, 0.05, 0.95e-3, "cpu"), ("rk4", 0.01, 0.01, 1e-3, "cpu"),
        ("rk4", 0.005, 1e-3, 1.4e-3, "cpu"), ("velocity-verlet", 0.005, 1e-5, 1e-4, "cpu"), unresolved=("velocity-verlet",),
    )  # fmt: skip
    (table,) = winner_tables(results)
    first, second, *_ = (dict(zip(HEAD, row, strict=True)) for row in table["rows"])
    assert (first["Method"], first["Step"]) == ("rk4", f"10{words.SPACE}ms")
    assert first["Tie"].startswith(f"lab, 20{words.SPACE}ms: ") and first["Tie"].endswith("error 0.050")
    assert (second["Step"], second["Tie"]) == (f"10{words.SPACE}ms", DASH)  # at 0.03 and 0.01 lab does not compete
    source = results.sources[0]
    assert all(p.integrator != "velocity-verlet" for p in reaching(points(source), 1.0))


def test_of_errors_that_are_printed_alike_the_fastest_wins() -> None:
    (table,) = winner_tables(
        made(CPU_RECORD, ("lab", 0.02, 5.04e-2, 0.95e-3, "cpu"), ("rk4", 0.01, 5.01e-2, 1e-3, "cpu"))
    )
    first = dict(zip(HEAD, table["rows"][0], strict=True))
    assert (first["Method"], first["Tie"]) == ("lab", DASH)


def test_a_time_beside_other_programs_is_marked_wherever_it_is_told() -> None:
    """A marked sample among four clean ones does not count; where all are marked their time is told with the mark."""
    store = Store(":memory:")
    maker = Maker(store, CPU_RECORD, "m")
    scene = load_scene("lab-curtain").replace({"method.integrator": "rk4", "method.dt": 0.01})
    maker.point_of(scene, 5e-4, 1e-3)
    maker.timing((16, 16), 1e-5, backend="cpu", threads=2, layer="omp", wait_policy="passive")
    what = configuration(scene, backend="cpu", threads=2, precision="float64")
    store.add_sample(maker.run, what, "sources", 9.0, 100, stage=STAGE, suspect="load: others")
    results = load(store)
    (table,) = winner_tables(results)
    assert table["rows"][0][HEAD.index("Simulated second")] == f"1.0{words.SPACE}ms" and "suspect" not in table["title"]
    assert "accuracy runs none;" in comparison.trust(results).sentence

    store.connection.execute("UPDATE sample SET suspect = 'load: others'")
    results = load(store)
    (table,) = winner_tables(results)
    assert table["rows"][0][HEAD.index("One run")].endswith("?") and table["title"].endswith(SUSPECT)
    assert "(suspect)" in accuracy.fastest(results).sentence
    assert "accuracy runs 1;" in comparison.trust(results).sentence
    (one,) = points(results.sources[0])
    assert "? ms a simulated second" in str(one)
    assert SUSPECT_NOTE in str(AccuracySummary("m", points=[one]))


def test_not_timed_is_not_not_reached() -> None:
    (table,) = winner_tables(made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"), ("rk4", 0.005, 5e-3, None, "cpu")))
    tenth, hundredth, *_, finest = table["rows"]
    assert tenth[3] == "rk4" and hundredth[2:] == ["0.03, 0.01", "reached, but not timed", *[DASH] * 7]
    assert finest[3].startswith("not reached; least 0.0050")


def test_the_readers_machine_comes_first_and_committed_ones_have_a_table_of_their_own() -> None:
    """The reader's one method answers for that machine, though a committed one gets there sooner."""
    mine = made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"))
    all_of_them = ("semi-implicit-euler", "velocity-verlet", "rk4", "lab")
    theirs = made(GPU_RECORD, *((name, 0.01, 0.05, 1e-4 * k, "cpu") for k, name in enumerate(all_of_them, 1)))
    committed = replace(theirs.sources[0], by_user=False)
    first, second = winner_tables(Results((mine.sources[0], committed)))
    assert first["rows"][0][3] == "rk4" and "committed" not in first["title"]
    assert second["rows"][0][3] == "semi-implicit-euler" and "committed" in second["title"]
    (table,) = winner_tables(Results((replace(mine.sources[0], by_user=False), committed)))
    assert table["rows"][0][3] == "rk4", "of two machines that timed the same the first one answers"


def test_a_committed_machine_does_not_share_the_readers_label() -> None:
    results = made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"))
    committed = Results((replace(results.sources[0], by_user=False),))
    (table,) = winner_tables(committed)
    assert table["title"].endswith("CPU Made-up CPU, 2 cores (committed)")
    assert winner_tables(Results(())) == []
