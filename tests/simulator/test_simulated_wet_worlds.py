"""Worlds with water on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from wet_scenes import wet_scene
from world_scenes import moving

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    with open_simulation(scene, backend, initial=moving(scene, 0.001), math="exact", **options) as simulation:
        simulation.advance(1)
        assert simulation.contacts_lost == 0
        return simulation.state()


def test_live_fields_reach_the_water() -> None:
    """What is set is set for all members: without gravity they move as if they had never had any."""
    scene = wet_scene("tetrahedra")
    ends = []
    for given, live in ((scene, ("gravity",)), (scene.replace({"gravity.enabled": False}), ())):
        options = {"initial": moving(scene, 0.001), "math": "exact", "precision": "float64", "kernel": "launch"}
        with open_simulation(given, "gpu", live=live, **options) as simulation:  # type: ignore[arg-type]
            if live:
                simulation.set("gravity.enabled", False)
            simulation.advance(1)
            ends.append(simulation.state().position)
    assert np.abs(ends[0] - ends[1]).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "precision", "kernel"),
    [
        ("bodies", "float32", "launch"),
        ("bodies that meet", "float32", "launch"),
        ("tetrahedra", "float64", "launch"),
        ("cloth", "float64", "stages"),
    ],
)
def test_bits_are_the_cpus(name: str, precision: str, kernel: str) -> None:
    scene = wet_scene(name)
    expected = end_state(scene, "cpu", precision=precision, threads=1)
    state = end_state(scene, "gpu", precision=precision, kernel=kernel)
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
