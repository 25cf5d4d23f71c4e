"""The sweep: what it plans, that it resumes, and that neither Ctrl-C nor kill -9 loses or repeats a finished sample."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from softlab.bench.experiments import sweep
from softlab.bench.experiments.group import GroupRunner
from softlab.bench.experiments.sweep import backends_here, run_sweep, shapes, source_hash
from softlab.bench.measure import experiment
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures, timings
from softlab.model.base.errors import InputError, SceneError

RECORD: dict[str, Any] = {"cpu": "Some CPU", "cores": 2}
SMALL: dict[str, Any] = {
    "backends": ["cpu"],
    "threads": ("1x",),
    "precisions": ("float32",),
    "graphics": False,
    "again": False,
    "progress": False,
    "min_seconds": 1e-4,
    "repeats": 2,
}


@pytest.fixture(autouse=True)
def known_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine that need not be measured first."""

    def enter(store: Store) -> str:
        store.add_machine("m1", "Some CPU, 2 cores; no GPU", RECORD)
        return "m1"

    monkeypatch.setattr(experiment, "enter_machine", enter)


def samples_of(store: Store) -> list[tuple[Any, ...]]:
    return store.query("SELECT configuration, run, stage, repeat, seconds, steps FROM sample ORDER BY 1, 3, 4")


def test_shapes_go_from_small_to_large_and_hold_odd_ones() -> None:
    for quick in (True, False):
        planned = shapes(quick)
        assert planned[0] == (16, 16) and (100, 100) in planned
        counts = [rows * columns for rows, columns in planned]
        assert counts == sorted(counts) and len(set(planned)) == len(planned)
        assert any(rows == 4 * columns for rows, columns in planned)
        assert any(columns == 4 * rows for rows, columns in planned)
    assert (4096, 4096) in shapes(False) and (256, 256) in shapes(True)
    assert shapes(True, [32, (3, 5)]) == [(3, 5), (32, 32)]
    with pytest.raises(SceneError):
        shapes(True, [0])


def test_an_unknown_backend_or_thread_word_is_refused_before_anything_is_stored(tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        backends_here(["tpu"])
    with Store(tmp_path / "results.sqlite") as store:
        with pytest.raises(SceneError):
            run_sweep(store, **(SMALL | {"threads": ("3y",)}))
        for value in (0, -1, float("nan"), float("inf")):
            with pytest.raises(SceneError):
                run_sweep(store, max_seconds=value, **SMALL)
        assert not store.query("SELECT * FROM run") and not store.query("SELECT * FROM machine")


def test_every_time_has_an_error_and_a_second_sweep_measures_nothing() -> None:
    with Store(":memory:") as store:
        options = SMALL | {"threads": ("1x", 1), "precisions": ("float32", "float64")}
        first = run_sweep(store, sizes=[8, (5, 7)], **options)
        assert first.measured == 8 and first.samples == 16 and first.wrong == []
        found = timings(store)
        assert len(found) == 8 and [t.particles for t in found] == sorted(t.particles for t in found)
        assert {t.kernel for t in found} <= {"team", "tiled"} and all(t.count == 2 for t in found)
        for timing in found:
            assert timing.error is not None and timing.error < (1e-3 if timing.precision == "float32" else 1e-9)
        assert {m.name for m in measures(store)} == {"error", "error_largest", "difference", "kernel"}
        assert all(m.reason for m in measures(store, "difference"))
        before = samples_of(store)
        again = run_sweep(store, sizes=[8, (5, 7)], **options)
        assert again.samples == 0 and again.stored == 8 and again.run == ""
        assert samples_of(store) == before
        more = run_sweep(store, sizes=[8, (5, 7)], **(options | {"repeats": 3}))
        assert more.samples == 8 and all(t.count == 3 for t in timings(store))


def test_changed_sources_are_measured_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    with Store(":memory:") as store:
        run_sweep(store, sizes=[8], **SMALL)
        monkeypatch.setattr(sweep, "source_hash", lambda backend: "changed")
        assert run_sweep(store, sizes=[8], **SMALL).samples == 2
        assert timings(store)[0].sources == "changed" and timings(store)[0].count == 2
    assert source_hash("cpu") != source_hash("gpu")


def test_what_would_take_too_long_is_not_started_and_says_so() -> None:
    with Store(":memory:") as store:
        summary = run_sweep(store, sizes=[8], max_seconds=1e-12, **SMALL)
        assert summary.samples == 0 and "--max-seconds" in summary.skipped[0][1]
        (skipped,) = measures(store, "skipped")
        assert skipped.value is None and skipped.reason == summary.skipped[0][1]
        assert run_sweep(store, sizes=[8], total_seconds=1e-12, **SMALL).samples == 0
        assert run_sweep(store, sizes=[8], **SMALL).samples == 2, "with more time it is measured after all"
        summary = run_sweep(store, sizes=[2**12], max_seconds=1e-3, **SMALL)
        assert summary.samples == 0 and "estimated" in summary.skipped[0][1]


def test_without_opengl_the_rest_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    offscreen = pytest.importorskip("softlab.app.output.offscreen")
    monkeypatch.setattr(offscreen, "opengl_available", lambda text: (False, "no EGL; apt install libegl1"))
    with Store(":memory:") as store:
        summary = run_sweep(store, sizes=[8], **(SMALL | {"graphics": True}))
        assert summary.measured == 1 and len(summary.skipped) == 1
        assert "libegl1" in summary.skipped[0][1] and not timings(store)[0].graphics


def test_a_wrong_answer_is_flagged(monkeypatch: pytest.MonkeyPatch) -> None:
    from softlab.bench.experiments import checks

    monkeypatch.setattr(checks, "LIMITS", {"float32": 0.0, "float64": 0.0})
    with Store(":memory:") as store:
        summary = run_sweep(store, sizes=[8], **SMALL)
        assert summary.wrong and any("wrong answer" in reason for reason in timings(store)[0].suspect)


def test_control_c_keeps_what_is_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    original, calls = Store.add_sample, []

    def interrupted(self: Store, *arguments: Any, **options: Any) -> int:
        repeat = original(self, *arguments, **options)
        calls.append(repeat)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return repeat

    with Store(":memory:") as store:
        monkeypatch.setattr(Store, "add_sample", interrupted)
        assert run_sweep(store, sizes=[8, 9], **SMALL).interrupted
        monkeypatch.setattr(Store, "add_sample", original)
        kept = samples_of(store)
        assert len(kept) == 3
        assert not run_sweep(store, sizes=[8, 9], **SMALL).interrupted
        assert set(kept) <= set(samples_of(store)) and [t.count for t in timings(store)] == [2, 2]


KILLED = """
import sys
from softlab.bench.experiments import sweep
from softlab.bench.measure import experiment
from softlab.bench.store.database import Store
def enter(store):
    store.add_machine("m1", "Some CPU, 2 cores; no GPU", {"cpu": "Some CPU", "cores": 2})
    return "m1"
experiment.enter_machine = enter
with Store(sys.argv[1]) as store:
    sweep.run_sweep(store, sizes=[8, 9, 10], backends=["cpu"], threads=("1x",), precisions=("float32",), graphics=False,
                    progress=False, min_seconds=1e-3, repeats=40, again=False)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kill -9 is a POSIX signal")
def test_kill_9_loses_no_finished_sample_and_repeats_none(tmp_path: Path) -> None:
    file = tmp_path / "results.sqlite"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(file)], stderr=subprocess.PIPE)
    try:
        give_up = time.monotonic() + 120
        seen: list[tuple[Any, ...]] = []
        while len(seen) < 45 and process.poll() is None and time.monotonic() < give_up:
            time.sleep(0.02)
            try:
                with Store(file, readonly=True) as watching:
                    seen = samples_of(watching)
            except InputError:
                continue  # not made yet
    finally:
        os.kill(process.pid, signal.SIGKILL)
        _, errors = process.communicate()
    assert len(seen) >= 45, errors.decode()
    with Store(file) as store:  # opens, and passes SQLite's own check
        survived = samples_of(store)
        assert set(seen) <= set(survived), "a finished sample was lost"
        run_sweep(store, sizes=[8, 9, 10], **(SMALL | {"repeats": 40, "min_seconds": 1e-3}))
        resumed = samples_of(store)
        assert set(survived) <= set(resumed)
        steps = [(key, repeat) for key, _, stage, repeat, *_ in resumed if stage == "step"]
        assert len(steps) == len(set(steps)) == 3 * 40, "none repeated, none missing"
        assert store.query("PRAGMA integrity_check") == [("ok",)]


def test_groups_fit_into_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    groups: list[list[str]] = []
    monkeypatch.setattr(GroupRunner, "measure", lambda self, group: groups.append([str(case) for case in group]))
    options = SMALL | {"precisions": ("float32", "float64")}
    with Store(":memory:") as store:
        run_sweep(store, sizes=[8], **options)
        assert [len(group) for group in groups] == [2]
        groups.clear()
        monkeypatch.setattr(sweep, "available_bytes", lambda: 64 * 300)
        run_sweep(store, sizes=[8], **options)
        assert [len(group) for group in groups] == [1, 1]
        groups.clear()
        monkeypatch.setattr(sweep, "available_bytes", lambda: 64 * 10)
        summary = run_sweep(store, sizes=[8], **options)
        assert groups == [] and all("main memory" in reason for _, reason in summary.skipped)


@pytest.mark.gpu
def test_on_a_real_gpu_both_backends_are_timed_and_agree() -> None:
    from softlab.bench.measure.machine import gpu_or_reason, gpu_simulated, measured_limits

    available, reason = gpu_or_reason()
    if not available or gpu_simulated():
        pytest.skip(reason if not available else "the CUDA simulator is no GPU")
    assert measured_limits()["gpu_copy_bandwidth"] > 0
    with Store(":memory:") as store:
        summary = run_sweep(store, sizes=[8, 64], **(SMALL | {"backends": None}))
        assert summary.wrong == [] and {t.backend for t in timings(store)} == {"cpu", "gpu"}
        differences = measures(store, "difference")
        assert len(differences) == 4 and all(m.value is not None and m.value < 1e-3 for m in differences)
