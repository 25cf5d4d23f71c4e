"""What lies on a block of tetrahedra, and what slides over it: heights, speeds and ways follow from gravity and friction."""

from __future__ import annotations

from typing import Any

import numpy as np
from world_scenes import BALL, BLOCK, CONTACT, JELLY

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

GRAVITY, RADIUS, DISTANCE, TOP = 9.81, 0.025, CONTACT["distance"], 0.05
SUBSTEP = 0.01 / 10
KEPT = RADIUS + DISTANCE / 2  # what a ball keeps from triangles
STILL: dict[str, Any] = {"velocity": [0.0] * 3, "spin": [0.0] * 3}


def scene_of(**tables: Any) -> Scene:
    contact = {"distance": DISTANCE, "sweeps": 4, "static_friction": 0.4, "dynamic_friction": 0.3}
    method = {"solver": "world", "dt": 0.01, "substeps": 10}
    return Scene({"gravity": {}, "contact": contact, "method": method} | tables)


def after(scene: Scene, seconds: float) -> tuple[State, dict[str, slice]]:
    with open_simulation(scene, "cpu", precision="float64", threads=1) as simulation:
        simulation.advance(round(seconds / scene.method.dt))
        if scene.is_world:
            assert simulation.contacts.lost == simulation.contacts.neighbours_lost == 0  # type: ignore[attr-defined]
        return simulation.state(), scene.world_set.slices() if scene.is_world else {}


def test_a_brick_comes_to_rest_on_a_block_that_is_held() -> None:
    """Its lowest particles lie at what balls keep from triangles over the block's top, but for what a substep falls, g h^2
    for each of the layers over them, and ten sweeps; they move no faster than it falls in a substep, g h."""
    block, brick = BLOCK | {"pinned": ["all"]}, BALL | {"origin": [0.0, TOP + 0.15, 0.0]} | STILL
    scene = scene_of(block=block, brick=brick)
    state, places = after(scene, 2.0)
    own = state.position[places["bodies"], 1]
    layers = 2
    assert abs(own.min() - (TOP + KEPT)) < 10 * layers * GRAVITY * SUBSTEP**2
    assert np.abs(state.velocity[places["bodies"]]).max() < GRAVITY * SUBSTEP
    held = places["tetrahedra"]
    assert np.array_equal(state.position[held], scene.world_set.position[held])


def test_a_brick_that_slides_stops_where_friction_says() -> None:
    """From v it goes v^2 / (2 mu g), mu being that of sliding, to a part in ten: it begins and ends within a substep, and the
    edges of triangles under its particles change what presses them."""
    speed, mu = 0.8, 0.3
    block = BLOCK | {"pinned": ["all"], "shape": BLOCK["shape"] | {"sides": [0.6, 0.1, 0.3]}}
    brick = BALL | {"origin": [-0.15, TOP + KEPT + RADIUS, 0.0]} | STILL | {"velocity": [speed, 0.0, 0.0]}
    scene = scene_of(block=block, brick=brick)
    begin = scene.world_set.position
    state, places = after(scene, 1.0)
    own = places["bodies"]
    gone = (state.position - begin)[own].mean(axis=0)
    assert abs(gone[0] / (speed**2 / (2 * mu * GRAVITY)) - 1) < 0.1
    assert np.abs(state.velocity[own]).max() < GRAVITY * SUBSTEP


def test_a_jelly_lies_on_a_soft_block_on_the_floor() -> None:
    """All comes to rest, slower than it would fall in a substep; the block's middle gives way under the jelly, which stays
    over it."""
    floor = {"kind": "plane", "point": [0.0, -0.06, 0.0], "static_friction": 0.5, "dynamic_friction": 0.4}
    block = BLOCK | {"damping": 0.02}
    jelly = JELLY | STILL | {"origin": [0.0, 0.16, 0.0], "cluster_damping": 20.0}
    scene = scene_of(block=block, jelly=jelly, floor=floor)
    state, places = after(scene, 3.0)
    assert np.abs(state.velocity).max() < GRAVITY * SUBSTEP
    top = state.position[places["tetrahedra"], 1].max()
    assert top + KEPT / 2 < state.position[places["bodies"], 1].min() < top + KEPT
    alone, _ = after(scene.members["tetrahedra"], 3.0)
    middle = np.argmin(np.linalg.norm(alone.position - [0.05, top, 0.05], axis=1))
    assert state.position[places["tetrahedra"]][middle, 1] < alone.position[middle, 1]
