"""The first page of the lab book: the soonest way to each error, from made-up runs."""

from __future__ import annotations

from dataclasses import replace

from synthetic_store import CPU_RECORD, GPU_RECORD, Maker

from bench.store.database import Store
from labbook import words
from labbook.answer import DASH, answer_tables
from plots.core.data import Results
from plots.core.read import load


def made(record: dict, *runs: tuple[str, float, float, float | None, str]) -> Results:
    """Runs of S1 in float32: (integrator, dt, error, cost, backend)."""
    store = Store(":memory:")
    maker = Maker(store, record, "m")
    for integrator, dt, error, cost, backend in runs:
        maker.point("lab-curtain", integrator, dt, error, cost, None, "float32", backend)
    return load(store)


def test_the_soonest_of_those_that_reach_the_error_and_where_it_breaks() -> None:
    results = made(
        GPU_RECORD,
        ("rk4", 0.01, 5e-4, 3e-3, "cpu"), ("rk4", 0.02, float("inf"), 1e-3, "cpu"), ("lab", 0.02, 0.05, 1e-4, "gpu"),
        ("velocity-verlet", 0.01, 5e-3, 2e-4, "gpu"),
    )  # fmt: skip
    (table,) = answer_tables(results)
    tenth, hundredth, thousandth = table["rows"]
    held = f"not up to 20{words.SPACE}ms"
    assert (
        [row[2] for row in table["rows"]] == ["0.1", "0.01", "0.001"]
        and tenth[1] == "1024"
        and hundredth[:2] == ["", ""]
    )
    assert table["title"].endswith("GPU Made-up GPU, CPU Made-up CPU, 16 cores")
    assert tenth[3:] == ["lab", f"20{words.SPACE}ms", "float32", "GPU", f"100{words.SPACE}µs", held]
    assert hundredth[3] == "velocity-verlet" and hundredth[-1] == f"not up to 10{words.SPACE}ms"
    assert thousandth[3:7] == ["rk4", f"10{words.SPACE}ms", "float32", "CPU"]
    assert thousandth[-1] == f"at 20{words.SPACE}ms"


def test_not_timed_is_not_not_reached() -> None:
    (table,) = answer_tables(made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"), ("rk4", 0.005, 5e-3, None, "cpu")))
    tenth, hundredth, thousandth = table["rows"]
    assert tenth[3] == "rk4" and hundredth[3:] == ["reached, but not timed", *[DASH] * 5]
    assert thousandth[3].startswith("not reached; least 0.0050")


def test_a_machine_with_few_of_the_methods_does_not_answer() -> None:
    """The reader's one method would be the soonest for want of others."""
    mine = made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"))
    all_of_them = ("semi-implicit-euler", "velocity-verlet", "rk4", "lab")
    theirs = made(GPU_RECORD, *((name, 0.01, 0.05, 1e-4 * k, "cpu") for k, name in enumerate(all_of_them, 1)))
    committed = replace(theirs.sources[0], own=False)
    (table,) = answer_tables(Results((mine.sources[0], committed)))
    assert table["rows"][0][3] == "semi-implicit-euler" and "committed" in table["title"]
    (table,) = answer_tables(Results((replace(theirs.sources[0], own=True), replace(mine.sources[0], own=False))))
    assert "committed" not in table["title"]


def test_a_committed_machine_does_not_share_the_readers_label() -> None:
    results = made(CPU_RECORD, ("rk4", 0.01, 0.05, 1e-3, "cpu"))
    committed = Results((replace(results.sources[0], own=False),))
    (table,) = answer_tables(committed)
    assert table["title"].endswith("CPU Made-up CPU, 2 cores (committed)")
    assert answer_tables(Results(())) == []
