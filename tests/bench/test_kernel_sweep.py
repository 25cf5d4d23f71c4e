"""Every kernel timed by name, joules beside them, limits and starts. Counters are made up, and no test needs a time."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from softlab.bench.experiments import kernel_runner, kernel_sweep
from softlab.bench.experiments.kernel_sweep import kernel_cases, kernels_of, run_kernel_sweep
from softlab.bench.experiments.sweep import run_sweep
from softlab.bench.measure import experiment, limits, starts
from softlab.bench.measure.cases import SweepSummary
from softlab.bench.measure.tables import print_fastest, print_kernels
from softlab.bench.measure.timing import Subject
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures, timings
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import load_scene

RECORD: dict[str, Any] = {"cpu": "Some CPU", "cores": 2, "arithmetic": {}, "region_policies": {}}
FEW = ("fused", "stages")  # kernels that take every size
SMALL: dict[str, Any] = {
    "backends": ["cpu"], "precisions": ("float32",), "repeats": 2, "min_seconds": 1e-4, "kernels": FEW,
    "energy": False, "starts": False, "progress": False, "again": False,
}  # fmt: skip


@pytest.fixture(autouse=True)
def known_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that need not be measured first, and is not crowded: one configuration a kernel."""

    def enter(store: Store) -> str:
        store.add_machine("m1", "Some CPU, 2 cores; no GPU", RECORD)
        return "m1"

    monkeypatch.setattr(experiment, "enter_machine", enter)
    monkeypatch.setattr(kernel_sweep, "MAX_CROWDED", 0)


# ---------------------------------------------------------------------- the sweep


def test_every_kernel_is_a_configuration_of_its_name_and_checked_and_resumed() -> None:
    with Store(":memory:") as store:
        first = run_kernel_sweep(store, sizes=[8, 12], **SMALL)
        assert first.measured == 4 and first.wrong == [] and first.skipped == []
        found = timings(store)
        assert {(t.kernel, t.rows) for t in found} == {(name, n) for name in FEW for n in (8, 12)}
        assert not any(t.chosen for t in found) and all(t.error is not None and t.error < 1e-3 for t in found)
        chosen = {m.description["kernel"]: m.value for m in measures(store, "default")}
        assert set(chosen) == set(FEW) and sum(value or 0 for value in chosen.values()) <= 1
        differences = {m.description["kernel"]: m for m in measures(store, "difference")}
        assert differences["fused"].value is None, "the plainest is what the others are held against"
        assert differences["stages"].value is not None and differences["stages"].value < 1e-3
        again = run_kernel_sweep(store, sizes=[8, 12], **SMALL)
        assert again.samples == 0 and again.stored == 4 and again.run == ""


def test_forced_and_chosen_kernels_do_not_mix() -> None:
    with Store(":memory:") as store:
        run_kernel_sweep(store, sizes=[8], **SMALL)
        ordinary = {name: SMALL[name] for name in ("backends", "precisions", "repeats", "min_seconds", "progress")}
        summary = run_sweep(store, sizes=[8], threads=("1x",), graphics=False, **ordinary)
        assert summary.measured == 1 and summary.stored == 0
        assert [t.chosen for t in timings(store)].count(True) == 1
        console = Console(record=True, width=100)
        print_fastest(console, store, "m1")
        print_kernels(console, store, "m1")
        text = console.export_text()
        assert "stages" in text and "fused" in text and "*" in text and "8 x 8" in text


def test_a_kernel_that_breaks_is_skipped_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    """In opening, in the check, and in the middle of the samples: the other kernel is timed all the same."""

    def broken(*_: Any, **__: Any) -> Any:
        raise RuntimeError("CUDA_ERROR_ILLEGAL_ADDRESS")

    original_check, original_sample = kernel_runner.against_reference, Subject.sample
    original_open = kernel_runner.Case.open
    breaks = {
        "open": lambda: monkeypatch.setattr(
            kernel_runner.Case, "open", lambda case: broken() if case.kernel == "stages" else original_open(case)
        ),
        "check": lambda: monkeypatch.setattr(
            kernel_runner, "against_reference", lambda s: broken() if s.kernel == "stages" else original_check(s)
        ),
        "sample": lambda: monkeypatch.setattr(
            Subject, "sample", lambda s, w: broken() if s.simulation.kernel == "stages" else original_sample(s, w)
        ),
    }
    for where, break_it in breaks.items():
        with monkeypatch.context(), Store(":memory:") as store:
            break_it()
            summary = run_kernel_sweep(store, sizes=[8], **SMALL)
            monkeypatch.undo()
            known = [t.kernel for t in timings(store)]
            assert known == ["fused"] and summary.measured == 1, where
            ((name, reason),) = summary.skipped
            assert "stages" in name and "ILLEGAL_ADDRESS" in reason, where
            (skipped,) = measures(store, "skipped")
            assert skipped.description["kernel"] == "stages"
        monkeypatch.setattr(experiment, "enter_machine", lambda s: s.add_machine("m1", "Some CPU", RECORD) or "m1")
        monkeypatch.setattr(kernel_sweep, "MAX_CROWDED", 0)


def test_a_wrong_kernel_is_flagged_and_never_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    original = kernel_runner.compare

    def wrong(simulation: Any, expected: Any, note: str) -> Any:
        return original(simulation, expected + 1.0, note)

    monkeypatch.setattr(kernel_runner, "compare", wrong)
    with Store(":memory:") as store:
        summary = run_kernel_sweep(store, sizes=[8], **SMALL)
        assert [name for name, _ in summary.wrong] == ["8 x 8 cpu stages 1x float32"]
        (timing,) = [t for t in timings(store) if t.kernel == "stages"]
        assert any("wrong answer" in mark for mark in timing.suspect)
        console = Console(record=True, width=100)
        print_kernels(console, store, "m1")
        (row,) = [line for line in console.export_text().splitlines() if line.strip().startswith("8 x 8")]
        assert row.rstrip().endswith("*"), "the last column is fused, the first stages"


def test_slow_kernels_get_fewer_samples_and_small_grids_more_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_sweep, "MAX_CROWDED", 64)
    scene = load_scene("lab-grid").replace({"grid.rows": 8, "grid.columns": 8})
    cases = kernel_cases(scene, ["cpu"], ("float32", "float64"), energy=True)
    assert {c.kernel for c in cases} == set(kernels_of("cpu")) and cases[0].kernel == "fused"
    assert {c.most_repeats for c in cases if c.kernel == "stages"} == {3}
    assert {c.word for c in cases if c.precision == "float32"} == {"1x", "2x", "4x"}
    assert {c.word for c in cases if c.precision == "float64" or c.kernel == "stages"} == {"1x"}
    assert {(c.precision, c.word) for c in cases if c.energy} == {("float32", "1x")}
    larger = kernel_cases(scene.replace({"grid.rows": 9}), ["cpu"], ("float32",), energy=False)
    assert {c.word for c in larger} == {"1x"} and not any(c.energy for c in larger)


def test_impossible_choices_are_refused_before_anything_is_stored() -> None:
    with Store(":memory:") as store:
        for options in ({"kernels": ("warp",)}, {"repeats": 0}, {"min_seconds": -1.0}, {"sizes": [0]}):
            with pytest.raises(SceneError):
                run_kernel_sweep(store, **(SMALL | options))
        assert not store.query("SELECT * FROM run") and not store.query("SELECT * FROM machine")


# ---------------------------------------------------------------------- limits and starts


def test_arithmetic_rates_are_measured_for_both_precisions() -> None:
    from softlab.cpu_backend.core.arithmetic import arithmetic_rate

    rates = {precision: arithmetic_rate(precision, 1, budget=0.0) for precision in ("float32", "float64")}
    assert all(rate > 1e7 for rate in rates.values())  # of any machine that runs this at all


def test_limits_are_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = []
    monkeypatch.setattr(limits, "cpu_arithmetic", lambda: measured.append("cpu") or {"float32": 1e11})
    monkeypatch.setattr(limits, "gpu_arithmetic", lambda: measured.append("gpu") or {"float32": 1e13})
    monkeypatch.setattr(limits, "region_policies", lambda: measured.append("regions") or {"active": {"1": 1e-6}})
    with Store(":memory:") as store:
        store.add_machine("m", "A machine", {"cpu": "Some CPU", "gpu": None})
        limits.enter_limits(store, "m")
        limits.enter_limits(store, "m")
        assert measured == ["cpu", "regions"]
        ((text,),) = store.query("SELECT record FROM machine")
        assert json.loads(text)["arithmetic"] == {"float32": 1e11}
        store.add_machine("g", "Another", {"gpu": "A GPU", "arithmetic": {}, "region_policies": {}})
        limits.enter_limits(store, "g")
        assert measured[2:] == ["gpu"]


def test_regions_are_measured_under_both_policies(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def run(words: list[str], **options: Any) -> Any:
        asked.append(options["env"]["OMP_WAIT_POLICY"])
        return SimpleNamespace(stdout='{"1": 1e-6}')

    monkeypatch.setattr(limits.subprocess, "run", run)
    assert limits.region_policies() == {"active": {"1": 1e-6}, "passive": {"1": 1e-6}}
    assert asked == ["active", "passive"]
    monkeypatch.setattr(limits.subprocess, "run", lambda *_, **__: SimpleNamespace(stdout="Traceback"))
    assert limits.region_policies() is None


def test_starts_are_measured_cold_and_warm_once(monkeypatch: pytest.MonkeyPatch) -> None:
    folders = []
    monkeypatch.setattr(starts, "start_seconds", lambda scene, backend, cache: folders.append(cache) or 1.5)
    with Store(":memory:") as store:
        store.add_machine("m", "A machine", {})
        run = store.start_run("m", "test")
        for _ in range(2):
            starts.measure_starts(store, run, "m", load_scene("lab-grid"), "cpu", "s")
        assert len(folders) == 2 and folders[0] == folders[1]
        assert {m.name: m.value for m in measures(store)} == {"start_seconds_cold": 1.5, "start_seconds_warm": 1.5}


# ---------------------------------------------------------------------- the command line


def test_the_command_line_passes_its_options_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from softlab import cli

    asked: dict[str, Any] = {}

    def run(store: Store, **options: Any) -> SweepSummary:
        asked.update(options)
        return SweepSummary("m1", "", interrupted=options["quick"])

    monkeypatch.setattr(kernel_sweep, "run_kernel_sweep", run)
    words = ["sweep", "--kernels", "--store", str(tmp_path / "r.sqlite"), "--size", "64", "--backend", "gpu"]
    words += ["--repeats", "3", "--min-ms", "20", "--no-energy", "--no-starts", "--precision", "float64"]
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 0, done.output
    assert asked["backends"] == ["gpu"] and asked["sizes"] == [64] and asked["repeats"] == 3
    assert asked["min_seconds"] == pytest.approx(0.02) and asked["precisions"] == ("float64",)
    assert not asked["energy"] and not asked["starts"] and asked["kernels"] is None
    assert CliRunner().invoke(cli.app, [*words, "--quick"]).exit_code == 130
    refused = CliRunner().invoke(cli.app, [*words, "--precision", "float16"])
    assert isinstance(refused.exception, SceneError)
