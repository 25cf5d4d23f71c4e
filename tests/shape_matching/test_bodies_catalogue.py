"""The scenes of bodies in the catalogue: what falls stays above what it falls on, nothing flies off, nothing sinks in."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.spare import present
from softlab.model.scene.scene import Scene, load_scene

SMALL = {
    "soft-rain": {"drop.copies": [2, 2, 1]},
    "soft-pile": {f"{name}.copies": [2, 1, 1] for name in ("star", "torus", "beam", "blob", "octopus")},
}
SCENES = ("jelly-drop", "two-worlds", "two-worlds-moon", "soft-rain", "soft-pile", "cloth-on-jelly", "plastic")
ROUNDING = 4 * 2.0**-24  # of a few metres, in float32


def scene_of(name: str) -> Scene:
    return load_scene(name).replace(SMALL.get(name, {}))


@pytest.mark.parametrize("name", SCENES)
def test_bodies_fall_onto_the_ground_and_stay(name: str) -> None:
    """For a second and a half: above the plane's thickness, below where they began, beside it by no more than they fell
    (what leaves the ground at an angle flies no farther); and no contact is lost."""
    scene = scene_of(name)
    begin = present(scene, scene.body_set.position)
    falls = np.sqrt(2 * begin[:, 1].min() / scene.gravity.acceleration)  # type: ignore[union-attr]  # s, the lowest one
    with open_simulation(scene, "cpu", threads=2) as simulation:
        for seconds in (falls, 1.5):
            simulation.advance(round((seconds - simulation.time) / scene.method.dt))
            position = present(scene, simulation.state().position)
            fallen = begin[:, 1].max() - position[:, 1].min()
            assert position[:, 1].min() > scene.parts["plane"].thickness - ROUNDING  # type: ignore[attr-defined]
            assert position[:, 1].max() < begin[:, 1].max()
            for axis in (0, 2):
                low, high = begin[:, axis].min() - fallen, begin[:, axis].max() + fallen
                assert low < position[:, axis].min() and position[:, axis].max() < high
        if scene.contact:
            assert simulation.contacts_lost == 0  # type: ignore[attr-defined]


def test_what_waits_in_jelly_drop_comes_in() -> None:
    """On top of the star; what was there is pushed, no particle is nearer to another body's than half their distance."""
    scene = load_scene("jelly-drop")
    body_set = scene.body_set
    with open_simulation(scene, "cpu", threads=2) as simulation:
        simulation.advance(60)
        number = simulation.add_body("blob", (0.0, 1.2, 0.0), (0.0, -2.0, 0.0))
        simulation.advance(60)
        position, weights = simulation.state().position, simulation.body.inverse_mass
    own, others = body_set.body == number, (body_set.body != number) & (weights > 0)
    away = np.linalg.norm(position[own][:, None] - position[others], axis=2)
    distance = 2 * scene.bodies["blob"].contact_radius
    assert 0.5 * distance < away.min() < 1.1 * distance
    assert position[own, 1].min() > position[others, 1].min() - ROUNDING
