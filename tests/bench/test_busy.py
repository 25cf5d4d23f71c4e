"""Threads beside another program (`softlab busy`): that the program runs and ends, what is stored, printed and told.
No test depends on a time."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from rich.console import Console
from synthetic_store import CPU_RECORD

from softlab.bench.experiments import busy
from softlab.bench.experiments.busy import (
    ALONE,
    BESIDE,
    FINDING,
    LIMIT,
    NICED,
    SAME,
    SCENES,
    Busy,
    beside,
    groups,
    points,
)
from softlab.bench.measure.costs_timing import RATIO, SECONDS, Effort
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures
from softlab.labbook.claims.busy import CLAIMS
from softlab.plots.core.read import load

TINY = Effort(2, 1e-4, 1e-3)


@pytest.mark.parametrize("kind", [NICED, SAME])
def test_the_program_runs_inside_and_is_gone_after(kind):
    with beside(kind) as program:
        assert program.poll() is None
        if hasattr(os, "getpriority"):
            assert os.getpriority(os.PRIO_PROCESS, program.pid) == min(19, os.nice(0) + BESIDE[kind])
    assert program.returncode is not None
    with pytest.raises(KeyboardInterrupt), beside(kind) as program:
        raise KeyboardInterrupt
    assert program.returncode is not None


def test_alone_means_alone():
    with beside(ALONE) as program:
        assert program is None


def test_every_scene_is_compared_in_every_company():
    found = groups(TINY)
    assert len(found) == len(BESIDE) * sum(len(kernels) for kernels in SCENES.values())
    for group in found:
        one, many = group.descriptions
        assert one["threads"] == 1 < many["threads"]
        assert {key for key in one if one[key] != many[key]} == {"threads"}
        assert one["finding"] == FINDING and one["wait_policy"]
    assert len({json.dumps(d, sort_keys=True) for g in found for d in g.descriptions}) == 2 * len(found)


def test_the_program_runs_while_samples_are_taken(monkeypatch, tmp_path):
    """And not while subjects are warmed up. Each way has its own thread count and the same steps."""
    running, seen = [], []
    inside = beside

    def watched(kind):
        running.append(kind)
        return inside(ALONE)

    def sampled(record, subjects, repeats):
        seen.append(([s.simulation.threads for s in subjects], {s.steps for s in subjects}, list(running)))
        return [{RATIO: (1.0, "", None), SECONDS: (1e-3, "s", None)} for _ in subjects]

    monkeypatch.setattr(busy, "beside", watched)
    monkeypatch.setattr(busy, "in_turn", sampled)
    monkeypatch.setattr(busy, "SHORT", TINY)
    with Store(tmp_path / "r.sqlite") as store:
        summary = Busy()(store, quick=True, scenes=["lab-grid"], progress=False)
        assert summary.measured == 6 and running == [*BESIDE, *BESIDE]
        for threads, steps, _ in seen:
            assert threads[0] == 1 < threads[1] and len(steps) == 1
        again = Busy()(store, quick=True, scenes=["lab-grid"], progress=False)
        assert (again.measured, again.stored) == (0, 6)
        assert len(points(measures(store))) == 6


def made_up(path: Path, ratios: dict[str, float]) -> Store:
    """A machine on which a step of soft-pile takes 8 ms on one thread, and so much of it on two."""
    store = Store(path)
    store.add_machine("cpu", "Made-up machine", CPU_RECORD)
    run = store.start_run("cpu", "softlab busy", None)
    for group in groups(TINY, ["soft-pile"]):
        one, many = group.descriptions
        ratio = ratios[one["beside"]]
        for description, taken, over in ((one, 0.008, 1.0), (many, 0.008 * ratio, ratio)):
            store.add_measure(run, description, group.sources, SECONDS, taken, "s", None)
            store.add_measure(run, description, group.sources, RATIO, over, "", None)
    return store


@pytest.mark.parametrize(("same", "good"), [(1.4, True), (9.0, False)])
def test_what_is_told_of_the_worst(tmp_path, same, good):
    ratios = {ALONE: 0.6, NICED: 1.1, SAME: same}
    with made_up(tmp_path / "r.sqlite", ratios) as store:
        found = points(measures(store))
        assert {p.beside: p.ratio for p in found} == ratios
        assert all(p.many == pytest.approx(p.ratio * p.one) for p in found)
        console = Console(width=160, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
        Busy().show(console, store, "cpu")
        text = console.export_text()
        assert "soft-pile" in text and f"{8 * same:.3g}" in text and f"{same:.2f}" in text
        claim = CLAIMS["busy"](load(store))
        assert claim.numbers == ratios and claim.supported == good == (same <= LIMIT)
        assert "soft-pile" in claim.sentence


def test_without_measurements_the_claim_says_so(tmp_path):
    with Store(tmp_path / "empty.sqlite") as store:
        claim = CLAIMS["busy"](load(store))
    assert "not measured" in claim.sentence and not claim.supported
