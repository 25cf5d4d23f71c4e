"""The CUDA kernels of bodies that meet, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from surface_scenes import crumpled_state, three

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    with open_simulation(scene, backend, initial=crumpled_state(scene), math="exact", **options) as simulation:
        simulation.advance(1)
        contacts = simulation.contacts  # type: ignore[attr-defined]
        found = contacts.contact_counts if backend == "cpu" else contacts.contact_counts.copy_to_host()
        assert np.count_nonzero(found) > 10 and contacts.lost == contacts.neighbours_lost == 0
        return simulation.state()


@pytest.mark.parametrize(
    ("precision", "kernel", "friction"),
    [("float32", "launch", 0.4), ("float64", "stages", 0.4), ("float64", "launch", 0.0)],
)
def test_bits_are_the_cpus(precision: str, kernel: str, friction: float) -> None:
    scene = three(static_friction=friction, dynamic_friction=friction)
    expected = end_state(scene, "cpu", precision=precision, threads=1)
    state = end_state(scene, "gpu", precision=precision, kernel=kernel)
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
