"""Tetrahedral bodies that meet, on a real GPU: the bits of the CPU's in exact math, and laws in fast math."""

from __future__ import annotations

import numpy as np
import pytest
from surface_scenes import box, meeting

from softlab.app.driver import open_simulation
from softlab.model.contact.surface_parameters import contact_distance

pytestmark = pytest.mark.gpu


def test_fast_math_keeps_momentum_and_bodies_apart() -> None:
    """Two cubes that collide in float32: every substep rounds a position of less than a metre, eps/h is 1.4e-4 m/s."""
    scene = meeting(
        left=box(origin=[-0.2, 0.0, 0.0], velocity=[1.0, 0.0, 0.0]),
        right=box(origin=[0.2, 0.04, 0.02], velocity=[-1.0, 0.0, 0.0]),
    )
    found = scene.tetrahedra_set
    mass, many = found.masses[:, None], int(found.first_particle[1])
    with open_simulation(scene, "gpu") as simulation:
        nearest = np.inf
        for _ in range(40):
            simulation.advance(1)
            position = simulation.read("position")
            nearest = min(nearest, float(position[many:, 0].min() - position[:many, 0].max()))
        velocity = simulation.state().velocity
    assert np.abs((mass * velocity).sum(axis=0)).max() < 2e-2 * float(mass.sum())
    assert nearest > 0.1 * contact_distance(scene)
    assert velocity[:many, 0].mean() < -0.1 and velocity[many:, 0].mean() > 0.1
