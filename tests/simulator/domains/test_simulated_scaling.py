"""`softlab sweep --gpus`, under the simulator: what the store holds and what is printed. Times of it mean nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from softlab.bench.experiments.scaling.experiment import Scaling, speedups, weak_efficiencies
from softlab.bench.measure import case_timing
from softlab.bench.measure.case_timing import Row
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures, timings
from softlab.model.base.errors import SceneError


def linked(row: Row) -> Row:
    """The same row, as if each window had a GPU."""
    return replace(row, fields=dict(row.fields) | {"link": lambda _: "flags"})


def test_a_sweep_over_gpus_is_stored_checked_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case_timing, "SAMPLE_SECONDS", 0.001)
    how = {"quick": True, "backends": ["gpu"], "gpus": [2], "sizes": [4], "progress": False}
    with Store(tmp_path / "store.sqlite") as store:
        summary = Scaling()(store, **how)
        found = Scaling().rows(measures(store))
        told = [(p.gpus, p.rows, p.link, p.difference) for p in found]
        assert told == [(1, 4, "", None), (2, 4, "flags by turns", 0.0)], "there is but one here"
        assert all(p.rate == pytest.approx(16 / p.step) for p in found)
        assert speedups(found) == [], "windows that take turns are no GPUs of their own"
        own = [linked(p) if p.gpus > 1 else p for p in found]
        assert len(speedups(own)) == 1
        assert timings(store) == [], "ordinary figures know one GPU alone"
        console = Console(record=True, width=160)
        Scaling().show(console, store, summary.machine)
        assert "4 x 4" in console.export_text()
        assert Scaling()(store, **how).measured == 0, "all is there"


def test_a_share_for_each_gpu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """--weak: 2 windows of 4 rows each, whose rate is held against that of 4 rows alone."""
    monkeypatch.setattr(case_timing, "SAMPLE_SECONDS", 0.001)
    how = {"quick": True, "backends": ["gpu"], "gpus": [2], "sizes": [4], "progress": False}
    with Store(tmp_path / "store.sqlite") as store:
        Scaling()(store, weak=True, **how)
        with pytest.raises(SceneError, match="use flags, which is faster, or nccl"):
            Scaling()(store, links=["peer"], **how)
        found = Scaling().rows(measures(store))
        assert [(p.rows, p.columns, p.gpus, p.link) for p in found] == [
            (4, 4, 1, ""), (8, 4, 2, "flags by turns"),
        ]  # fmt: skip
        own = [linked(p) for p in found]
        weak = weak_efficiencies(own)
        assert [weak[id(p)] for p in own[1:]] == [pytest.approx(p.rate / (2 * own[0].rate)) for p in own[1:]]


def test_bad_choices_are_told(tmp_path: Path) -> None:
    with Store(tmp_path / "store.sqlite") as store:
        gpu = {"backends": ["gpu"]}
        for wrong in ({"backends": ["cpu"]}, gpu | {"gpus": [0]}):
            with pytest.raises(SceneError, match="gpus"):
                Scaling()(store, progress=False, **wrong)
