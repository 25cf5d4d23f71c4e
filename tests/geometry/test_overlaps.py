"""Pinned masses inside a collider are told of, collider by collider; what only comes near them is not."""

import numpy as np
import pytest

from softlab.model.contact.overlaps import overlap_lines
from softlab.model.scene.scene import Scene

CLOTH = {"rows": 3, "columns": 5, "spacing": 0.1, "pinned": "top", "placement": "flat"}  # pins: x = 0 to 0.4, y = z = 0
BODIES = {
    "sphere": {"center": [0.2, 0.0, 0.0], "radius": 0.15, "thickness": 0.01},
    "capsule": {"start": [0.0, 0.0, 0.0], "end": [0.2, 0.0, 0.0], "radius": 0.05, "thickness": 0.01},
    "box": {"center": [0.4, 0.0, 0.0], "half_size": [0.11, 0.1, 0.1], "thickness": 0.0},
    "plane": {"point": [0.0, -0.005, 0.0], "thickness": 0.01},
}
INSIDE = {"sphere": 3, "capsule": 3, "box": 2, "plane": 5}  # counted by hand


@pytest.mark.parametrize("kind", BODIES)
def test_pins_inside_a_collider_are_counted(kind):
    scene = Scene({"cloth": CLOTH, "structural": {}, kind: BODIES[kind]})
    (line,) = overlap_lines(scene)
    assert line.startswith(f"{INSIDE[kind]} of 5 pinned masses begin inside a {kind}")


def test_nothing_is_told_where_nothing_overlaps():
    far = Scene({"cloth": CLOTH, "structural": {}, "sphere": {"center": [0.0, 5.0, 0.0], "radius": 0.1}})
    assert overlap_lines(far) == []
    small = BODIES["sphere"] | {"radius": 0.04}  # nothing free lies deeper in it than half a spacing
    assert overlap_lines(Scene({"cloth": CLOTH | {"pinned": "none"}, "structural": {}, "sphere": small})) == []
    assert overlap_lines(Scene({"grid": {"rows": 2, "columns": 2, "pinned": "top"}})) == []


def test_free_masses_deep_inside_are_told():
    """A sheet of 9 x 9 masses, 0.1 m apart, through the middle of a ball of 0.25 m: those within 0.2 m of its centre."""
    sheet = {"rows": 9, "columns": 9, "spacing": 0.1, "origin": (-0.4, 0.4, 0.0)}
    scene = Scene({"cloth": sheet, "structural": {}, "sphere": {"radius": 0.25}})
    x = 0.1 * np.arange(-4, 5)
    deep = int((np.hypot(x[:, None], x) < 0.2 - 1e-9).sum())
    (line,) = overlap_lines(scene)
    assert line.startswith(f"{deep} of 81 free masses begin deep inside a sphere")
    assert overlap_lines(scene.replace({"sphere.radius": 0.02})) == []


def test_water_in_a_box_is_told_what_a_tank_is_made_of():
    """A box is no container: all of the water, 4 x 4 x 4 particles, begins inside of it."""
    water = {"kind": "fluid", "origin": [0.3, 0.3, 0.3], "size": [0.4, 0.4, 0.4], "rest_distance": 0.1}
    box = {"kind": "box", "center": [0.5, 0.5, 0.5], "half_size": [0.5, 0.5, 0.5]}
    (line,) = overlap_lines(Scene({"water": water, "tank": box}))
    assert line.startswith("64 of 64 free masses begin deep inside a box") and "a tank is made of planes" in line
    (line,) = overlap_lines(Scene({"water": water, "floor": {"kind": "plane", "point": [0.0, 2.0, 0.0]}}))
    assert "tank" not in line
