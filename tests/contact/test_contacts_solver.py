"""A cloth that touches itself, by its solver: the reference's motion, threads, what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_scenes import folded

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring
from softlab.bench.reference.contact import self_contacts as reference
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

# ---------------------------------------------------------------------- in the solver


def end_state(scene: Scene, steps: int, **options: Any) -> State:
    with open_simulation(
        scene, "cpu", **{"precision": "float64", "math": "exact", "threads": 1} | options
    ) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_a_folded_strip_that_falls_follows_the_reference(ordering: str) -> None:
    """Layers come down on the floor and on one another, 24 substeps; a substep is some hundred roundings of lengths under
    1 m, and contacts forget errors rather than let them grow."""
    scene = folded(10, 5, layer=4).replace({"method.ordering": ordering})
    state = end_state(scene, 6)
    position, velocity = reference.simulate(scene, 6, *mass_spring.start(scene), MAX_CONTACTS)
    h = scene.method.dt / scene.method.substeps
    assert np.abs(state.position - position).max() < 1e-12
    assert np.abs(state.velocity - velocity).max() < 1e-12 / h
    free = end_state(Scene({k: t for k, t in scene.as_dict().items() if k != "self_collision"}), 6)
    assert np.abs(free.position - position).max() > 1e-3


# ---------------------------------------------------------------------- scenes that cannot be
