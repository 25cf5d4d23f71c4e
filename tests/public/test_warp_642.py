"""warp 642, bullet3 3882: neo-Hookean tetrahedra under XPBD move, and gain energy, without any load.

Two rows, of |F| and of det F - alpha, hold each other at rest, but only once both have their multipliers: from 0, one after
the other, each sweep moved the body. A cube of 0.3 m had a strain of 0.56 after a second, and 600 J; at Poisson's ratio 0
it fell into a point.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "xpbd", "dt": 1 / 60, "substeps": 1}
CUBE: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.3, 0.3, 0.3]}, "edge": 0.15, "young_modulus": 1e5,
    "material": "neo-hookean",
}  # fmt: skip
STEPS = 20
HOW: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({}, {}), ({}, {"iterations": 3}), ({"damping": 0.01}, {"iterations": 2}), ({"volume": "voxels"}, {"iterations": 2}),
    ({"volume": "voxels", "damping": 0.01}, {}), ({"tetrahedra": 6}, {}), ({}, {"dt": 1.0}), ({}, {"substeps": 4}),
]  # fmt: skip
CASES = [(nu, HOW[0], real) for nu, real in product((0.0, 0.3, 0.49), ("float64", "float32"))] + [
    ((0.0, 0.3, 0.45, 0.49)[n % 4], how, ("float64", "float32")[n % 2]) for n, how in enumerate(HOW[1:])
]


@pytest.mark.parametrize(("poisson", "how", "precision"), CASES)
def test_an_unloaded_cube_stays(poisson: float, how: tuple[dict[str, Any], dict[str, Any]], precision: Any) -> None:
    """To rounding: a visit leaves a place within an ulp of its coordinate, and takes up a residual F - cof F that is some
    ulps of 1, times an edge; what it leaves, the next visit takes up. An ulp of the cube's side in a step."""
    body, method = how
    scene = Scene({"box": CUBE | {"poisson_ratio": poisson} | body, "method": METHOD | method})
    ulp = 0.3 * float(np.finfo(precision).eps)
    with open_simulation(scene, "cpu", precision=precision, math="exact", threads=1) as simulation:
        begin = simulation.state().position
        simulation.advance(STEPS)
        end = simulation.state()
        stored = simulation.energies()["spring"]
    h = scene.method.dt / scene.method.substeps
    assert np.abs(end.position - begin).max() <= STEPS * ulp
    assert np.abs(end.velocity).max() <= STEPS * ulp / h
    assert stored <= 1e5 * 0.3**3 * 1e3 * np.finfo(precision).eps ** 2 + 1e-12  # E V strain^2; sums round, too


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_a_strained_cube_gains_no_energy(poisson: float) -> None:
    """Let go with each vertex off by up to a per cent of an edge: at a step in which sound crosses an edge once, stored and
    moving energy stays below what it began with, and implicit steps take half of it within twenty."""
    scene = Scene({"box": CUBE | {"poisson_ratio": poisson}, "method": METHOD | {"iterations": 4}})
    body = build(scene)
    position = body.position + np.random.default_rng(2).uniform(-1.5e-3, 1.5e-3, body.position.shape)
    start = State(position, np.zeros_like(position), body.inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", initial=start, precision="float64", math="exact", threads=1) as simulation:
        totals = []
        for _ in range(STEPS):
            totals.append(sum(simulation.energies()[kind] for kind in ("spring", "kinetic")))
            simulation.advance(1)
    assert max(totals) <= totals[0] and totals[-1] < totals[0] / 2
