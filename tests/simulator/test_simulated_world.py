"""Worlds of several families on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from world_scenes import moving, world_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    with open_simulation(scene, backend, initial=moving(scene), math="exact", **options) as simulation:
        simulation.advance(1)
        contacts: Any = simulation.contacts  # type: ignore[attr-defined]
        if contacts is not None:
            found = contacts.contact_counts if backend == "cpu" else contacts.contact_counts.copy_to_host()
            assert np.count_nonzero(found) and contacts.lost == contacts.neighbours_lost == 0
        return simulation.state()


@pytest.mark.parametrize(
    ("name", "precision", "kernel"),
    [
        ("all", "float32", "launch"),
        ("jelly on a cloth", "float64", "stages"),
        ("jelly on a block by vertices", "float32", "launch"),
        ("jelly on a block by vertices", "float64", "stages"),
    ],
)
def test_bits_are_the_cpus(name: str, precision: str, kernel: str) -> None:
    scene = world_scene(name)
    expected = end_state(scene, "cpu", precision=precision, threads=1)
    state = end_state(scene, "gpu", precision=precision, kernel=kernel)
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
    assert np.array_equal(state.rotation, expected.rotation)  # type: ignore[arg-type]


def test_members_that_nothing_couples_move_as_each_alone() -> None:
    scene = world_scene("jelly on a block", contact=None)
    begin, state = moving(scene), end_state(scene, "gpu", precision="float32", kernel="launch")
    for name, place in scene.world_set.slices().items():
        part = State(begin.position[place], begin.velocity[place], begin.inverse_mass[place], 0.0, 0)
        with open_simulation(scene.members[name], "gpu", initial=part, math="exact", kernel="launch") as alone:
            alone.advance(1)
            assert np.array_equal(alone.state().position, state.position[place]), name
