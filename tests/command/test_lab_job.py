"""`softlab lab`: its parts in order, how far the whole is, how long it took last time, what is lost when a part fails."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from softlab.bench.measure import progress
from softlab.bench.measure.progress import Whole, last_seconds, progress_bar, store_seconds
from softlab.labbook import jobs
from softlab.model.base import kernel_cache
from softlab.model.base.errors import BackendUnavailable, InputError

RUNS = {
    "softlab.bench.experiments.sweep.run_sweep": "sweep",
    "softlab.bench.experiments.accuracy.experiment.Accuracy.__call__": "accuracy",
    "softlab.bench.experiments.findings.experiment.Findings.__call__": "findings",
    "softlab.bench.experiments.findings.costs.Costs.__call__": "costs",
    "softlab.bench.experiments.convergence.Convergence.__call__": "convergence",
    "softlab.bench.experiments.projections.Projections.__call__": "projections",
    "softlab.bench.experiments.throughput.Throughput.__call__": "throughput",
    "softlab.bench.experiments.bar_rows.BarMaterial.__call__": "bar",
    "softlab.bench.experiments.bar_costs.BarCosts.__call__": "bar costs",
    "softlab.bench.experiments.busy.Busy.__call__": "busy",
    "softlab.bench.experiments.tetrahedral.decides.Tetrahedra.__call__": "tetrahedra",
    "softlab.bench.experiments.tetrahedral.meshes.Meshes.__call__": "meshes",
    "softlab.bench.experiments.stability.experiment.Stability.__call__": "stability",
    "softlab.bench.stress.experiment.Hard.__call__": "hard",
    "softlab.bench.experiments.advise.ablate.ablate": "ablate",
}
DONE: list[str] = []


@pytest.fixture(autouse=True)
def everything_is_made_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Commands that measure nothing, a doctor that looks at nothing, figures and a book that are not drawn."""
    DONE.clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def run(name: str) -> Any:
        def measure(*_: Any, **how: Any) -> Any:
            DONE.append(f"{name} quick" if how.get("quick") else name)
            return SimpleNamespace(interrupted=False)

        return measure

    for path, name in RUNS.items():
        monkeypatch.setattr(path, run(name))
    for path in (
        "softlab.bench.measure.tables.print_sweep",
        "softlab.bench.stress.report.print_hard",
        "softlab.bench.experiments.advise.ablation_results.print_ablation",
    ):
        monkeypatch.setattr(path, lambda *_: None)
    monkeypatch.setattr("softlab.bench.measure.tables.print_fastest", lambda *_: DONE.append("fastest"))
    monkeypatch.setattr("softlab.bench.measure.machine.enter_machine", lambda _: "machine")
    monkeypatch.setattr("softlab.app.command.doctor.examine", lambda: [])
    monkeypatch.setattr(jobs, "load", lambda *_: "results")
    monkeypatch.setattr(jobs, "draw_figures", lambda *_, **__: DONE.append("figures") or [])
    monkeypatch.setattr(jobs, "write_book", lambda *_, **__: DONE.append("book") or Path("labbook.pdf"))
    yield


def lab(tmp_path: Path, quick: bool = True) -> str:
    console = Console(record=True, width=200)
    jobs.whole_lab(console, quick=quick, store_path=tmp_path / "results.sqlite", command="softlab lab")
    return console.export_text()


def test_quick_is_sweep_accuracy_and_stability(tmp_path: Path) -> None:
    text = lab(tmp_path)
    runs = ["sweep quick", "accuracy quick", "stability quick"]  # once to gather what is compiled, once to measure
    assert [*runs, *runs, "figures", "book", "fastest"] == DONE
    assert "labbook.pdf" in text and "results.sqlite" in text


def test_the_whole_lab_leaves_nothing_out(tmp_path: Path) -> None:
    lab(tmp_path, quick=False)
    assert {*RUNS.values(), "figures", "book"} <= set(DONE) and not any("quick" in name for name in DONE)
    assert DONE.index("stability") < DONE.index("hard") < DONE.index("figures")


def test_it_says_how_long_it_took_last_time(tmp_path: Path) -> None:
    assert "last time" not in lab(tmp_path)
    store_seconds("lab --quick", {"sweep: time per step": 12.34, "accuracy: speed against error": 30.0})
    assert "last time this took 42 s" in lab(tmp_path)
    assert "last time" not in lab(tmp_path, quick=False)  # which takes another time
    assert set(last_seconds("lab --quick")) == {  # of the second one now
        "doctor", "kernels and references: made before anything is measured", "sweep: time per step",
        "accuracy: speed against error", "stability: where it breaks",
        "figures and lab book",
    }  # fmt: skip


def test_ctrl_c_ends_it_and_is_not_the_time_it_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "softlab.bench.experiments.accuracy.experiment.Accuracy.__call__",
        lambda *_, **__: SimpleNamespace(interrupted=True),
    )
    with pytest.raises(KeyboardInterrupt):
        lab(tmp_path)
    assert DONE == ["sweep quick"] and last_seconds("lab --quick") == {} and Whole.current is None


def test_figures_that_cannot_be_written_and_a_book_that_cannot_cost_the_rest_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise InputError("the disk is full")

    def missing(*_: Any, **__: Any) -> None:
        raise BackendUnavailable("typst cannot be loaded", "pip install typst")

    monkeypatch.setattr(jobs, "draw_figures", full)
    text = lab(tmp_path)
    assert "the disk is full" in text and "labbook.pdf" in text and DONE[-1] == "fastest"
    monkeypatch.setattr(jobs, "write_book", missing)
    assert "pip install typst" in lab(tmp_path)


# ---------------------------------------------------------------------- the bar


def test_the_bar_tells_the_whole_and_what_is_compiled() -> None:
    whole = Whole("lab", {"sweep": 2.0, "accuracy": 6.0})
    shares = []
    for name in whole.expected:
        with whole.part(name), progress_bar(False) as bar:
            task = bar.add_task(name, total=4)
            for _ in range(2):
                bar.update(task, description="S1 rk4", advance=1)
            bar.get_renderables()
            shares.append((bar.tasks[0].description, bar.tasks[0].completed))
            for watcher in list(kernel_cache._watchers):
                watcher("team kernel", 3.4)
            assert bar.tasks[1].description == "compiling team kernel, 3 s last time"
            bar.update(task, description="S1 rk4")
            assert bar.tasks[1].description == "S1 rk4"
    assert shares == [("lab, 1 of 2: sweep", 1.0), ("lab, 2 of 2: accuracy", 5.0)]
    assert not kernel_cache._watchers and list(whole.seconds) == ["sweep", "accuracy"]
    with progress_bar(False) as bar:
        bar.add_task("alone")
        assert [task.description for task in bar.tasks] == ["alone"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"lab": 3}', '{"lab": {"sweep": "long"}}', "\0"])
def test_times_that_cannot_be_read_are_not_known(text: str, tmp_path: Path) -> None:
    store_seconds("other", {"sweep": 1.0})
    (file,) = (tmp_path / "cache").rglob(progress.SECONDS)
    file.write_text(text)
    assert last_seconds("lab") == {}
    store_seconds("lab", {"sweep": 2.0})
    assert json.loads(file.read_text())["lab"] == last_seconds("lab") == {"sweep": 2.0}
