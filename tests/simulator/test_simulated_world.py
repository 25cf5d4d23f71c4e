"""Worlds of several families on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

from typing import Any

import numpy as np
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


def test_members_that_nothing_couples_move_as_each_alone() -> None:
    scene = world_scene("jelly on a block", contact=None)
    begin, state = moving(scene), end_state(scene, "gpu", precision="float32", kernel="launch")
    for name, place in scene.world_set.slices().items():
        part = State(begin.position[place], begin.velocity[place], begin.inverse_mass[place], 0.0, 0)
        with open_simulation(scene.members[name], "gpu", initial=part, math="exact", kernel="launch") as alone:
            alone.advance(1)
            assert np.array_equal(alone.state().position, state.position[place]), name
