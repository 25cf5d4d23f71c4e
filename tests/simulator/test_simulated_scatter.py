"""The scatters of bench/experiments/findings/scatter_gpu.py at 8 x 8 masses, against the lab's own kernel: the same sums in
another order."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.bench.experiments.checks import LIMITS, displaced
from softlab.bench.experiments.findings import determinism as findings_determinism
from softlab.bench.experiments.findings.determinism import (
    DIFFERENT,
    DISTANCE,
    GATHER,
    OTHERS,
    determinism,
    different_runs,
    open_variant,
)
from softlab.bench.measure.costs_timing import RATIO, Effort, Record
from softlab.bench.measure.machine import enter_machine
from softlab.bench.store.database import Store
from softlab.model.scene.scene import load_scene

STEPS = 6


@pytest.mark.parametrize("precision", LIMITS)
@pytest.mark.parametrize("how", OTHERS["gpu"])
def test_a_scatter_does_what_the_gather_does(how: str, precision: str) -> None:
    """To rounding: the bound of every check of a kernel at such a size."""
    scene = load_scene("lab-grid").replace({"grid.rows": 8, "grid.columns": 8})
    with (
        open_variant(scene, "gpu", precision, GATHER) as right,
        open_variant(scene, "gpu", precision, how) as simulation,
    ):
        start = displaced(right)
        ends = []
        for each in (right, simulation):
            each.load(start)
            each.advance(STEPS - 2)
            each.advance(2)
            ends.append(each.state())
        assert simulation.kernel == how
        assert np.abs(ends[0].position - start.position).max() > 10 * LIMITS[precision]
        assert np.abs(ends[1].position - ends[0].position).max() < LIMITS[precision]
        assert np.abs(ends[1].velocity - ends[0].velocity).max() < LIMITS[precision] / scene.method.dt
        pinned = simulation.body.pinned
        assert np.array_equal(ends[1].position[pinned], start.position[pinned].astype(simulation.real))
        assert different_runs(simulation, start, 2, 2) == 0  # the simulator's threads take turns in one order


def test_the_cost_is_measured_beside_the_gather(monkeypatch) -> None:
    """The whole of a group: checked, repeated, timed, and marked as no time of a GPU."""
    monkeypatch.setattr(findings_determinism, "SIZES", {"gpu": (8,)})
    monkeypatch.setattr(findings_determinism, "PRECISIONS", ("float64",))
    monkeypatch.setattr(findings_determinism, "RUNS", 2)
    monkeypatch.setattr(findings_determinism, "RUN_STEPS", 2)
    (group,) = determinism("gpu", Effort(1, 1e-3, 1e-2))
    with Store(":memory:") as store:
        run = store.start_run(enter_machine(store), "test")
        found = group.measure(Record(store, run, group.sources))
    assert [way["sums"] for way in group.descriptions] == [GATHER, *OTHERS["gpu"]]
    for numbers in found:
        assert numbers[DIFFERENT][0] == 0
        assert numbers[DISTANCE][0] < LIMITS["float64"]
        assert "CUDA simulator" in numbers[RATIO][2]
