"""The stability runs on the GPU's kernels, tiny: the same outcome and the same edge as on the CPU, with what is live."""

from __future__ import annotations

import pytest

from softlab.app.driver import open_simulation
from softlab.bench.experiments.stability import runs as stability_runs
from softlab.bench.experiments.stability.runs import DIVERGED, LIVE, MOVING, linear, measured_edge, outcome
from softlab.model.scene.scene import Scene, load_scene


def small(integrator: str) -> Scene:
    return load_scene("lab-curtain").replace({"grid.rows": 4, "grid.columns": 3, "method.integrator": integrator})


@pytest.mark.parametrize(("dt", "code"), [(0.001, MOVING), (0.1, DIVERGED)])
def test_outcomes_are_the_cpus(dt, code, monkeypatch):
    """16 steps under the limit, and until it diverges at three times it: step and note are the same."""
    monkeypatch.setattr(stability_runs, "END", 0.016)
    monkeypatch.setattr(stability_runs, "MIN_STEPS", 16)
    monkeypatch.setattr(stability_runs, "MIN_CHECKS", 4)
    found = []
    for backend in ("cpu", "gpu"):
        options = {"kernel": "stages"} if backend == "cpu" else {}
        with open_simulation(
            small("lab"), backend, precision="float64", math="exact", live=LIVE, allow_unstable=True, **options
        ) as simulation:
            found.append(outcome(simulation, dt, 1000.0 if dt > 0.01 else 10.0, 0.03))
    assert found[0] == found[1]
    assert found[0].code == code


def test_an_edge_is_found_on_the_gpu(monkeypatch):
    """Few steps and a wide interval: within it, the analytic one, 2 / w."""
    monkeypatch.setattr(stability_runs, "UNDAMPED_STEPS", 32)
    monkeypatch.setattr(stability_runs, "FIRST", 1.0)
    scene = linear(small("velocity-verlet")).replace({"damping.coefficient": 0.0, "grid.columns": 1})
    with open_simulation(scene, "gpu", precision="float64", live=LIVE, allow_unstable=True) as simulation:
        edge = measured_edge(simulation, 0.3)
    assert edge == pytest.approx(2 / stability_runs.edge_start(scene)[1], rel=0.3)
