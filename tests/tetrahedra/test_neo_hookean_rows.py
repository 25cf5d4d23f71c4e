"""Where sweeps of neo-Hookean rows end: the step of implicit Euler of the energy that is reported."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.material import energies

H = 1 / 60
VOXEL: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.1, 0.1, 0.1]}, "edge": 0.1, "young_modulus": 1e4,
    "material": "neo-hookean", "density": 1000.0,
}  # fmt: skip


def unbalanced(scene: Scene, position: np.ndarray, predicted: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """(particles, 3) [N]: m (x - y) / h^2 + dW/dx, W the reported energy, by central differences."""
    force = np.zeros_like(position)
    for index in np.ndindex(position.shape):
        shift = np.zeros_like(position)
        shift[index] = 1e-6
        both = (float(energies(scene.tetrahedra_set, position + way * shift).sum()) for way in (1, -1))
        force[index] = (next(both) - next(both)) / 2e-6
    return mass[:, None] * (position - predicted) / H**2 + force


@pytest.mark.parametrize(
    ("poisson", "whole", "left"), [(0.0, False, 1e-6), (0.3, False, 1e-6), (0.45, False, 1e-6), (0.3, True, 2e-2)]
)
def test_sweeps_end_at_the_implicit_step_of_the_reported_energy(poisson: float, whole: bool, left: float) -> None:
    """At strains of a quarter: 1e-6 of the largest force is left, what differences of 1e-6 m leave of forces of 10 N. A
    voxel's row of its volume keeps its multiplier along gradients that turn, by the strain: some per cent of its force."""
    body = VOXEL | {"poisson_ratio": poisson} | ({"volume": "voxels"} if whole else {})
    scene = Scene({"box": body, "method": {"solver": "xpbd", "dt": H, "substeps": 1, "iterations": 150}})
    found = build(scene)
    mass = 1 / found.inverse_mass.ravel()
    random = np.random.default_rng(4)
    position = found.position * [1.15, 0.95, 0.9] + random.uniform(-0.008, 0.008, found.position.shape)
    velocity = random.normal(size=position.shape) * 0.3
    start = State(position, velocity, found.inverse_mass, 0.0, 0)
    with open_simulation(scene, "cpu", initial=start, precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(1)
        end = simulation.state().position
    predicted = position + H * velocity
    start_force = unbalanced(scene, predicted, predicted, mass)
    assert np.abs(unbalanced(scene, end, predicted, mass)).max() < left * np.abs(start_force).max()
