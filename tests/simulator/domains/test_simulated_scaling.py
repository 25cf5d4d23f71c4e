"""`softlab sweep --gpus`, under the simulator: what the store holds and what is printed. Times of it mean nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from bench.experiments.scaling.experiment import points, print_scaling, run_scaling, speedups
from bench.measure import case_timing
from bench.store.database import Store
from bench.store.results import measures, timings
from model.core.errors import SceneError


def test_a_sweep_over_gpus_is_stored_checked_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case_timing, "SAMPLE_SECONDS", 0.001)
    how = {"quick": True, "backends": ["gpu"], "gpus": [2], "sizes": [4], "progress": False}
    with Store(tmp_path / "store.sqlite") as store:
        summary = run_scaling(store, **how)
        found = points(measures(store))
        told = [(p.gpus, p.rows, p.link, p.difference) for p in found]
        assert told == [(1, 4, "", None), (2, 4, "peer by turns", 0.0)], "there is but one here"
        assert all(p.rate == pytest.approx(16 / p.step) for p in found)
        assert speedups(found) == [], "windows that take turns are no GPUs of their own"
        own = [replace(p, link="peer") if p.gpus > 1 else p for p in found]
        assert len(speedups(own)) == 1
        assert timings(store) == [], "ordinary figures know one GPU alone"
        console = Console(record=True, width=160)
        print_scaling(console, store, summary.machine)
        assert "4 x 4" in console.export_text()
        assert run_scaling(store, **how).measured == 0, "all is there"


def test_bad_choices_are_told(tmp_path: Path) -> None:
    with Store(tmp_path / "store.sqlite") as store:
        for wrong in ({"backends": ["cpu"]}, {"backends": ["gpu"], "gpus": [0]}):
            with pytest.raises(SceneError, match="--gpus"):
                run_scaling(store, progress=False, **wrong)
