"""Coulomb's law for xpbd tetrahedra on each kind of collider: a cube sticks at 0.9 mu and slides at 1.1 mu."""

from __future__ import annotations

from math import atan, cos, degrees, sin
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import Scene

SIDE, THICKNESS, RADIUS, MU, G = 0.3, 0.01, 200.0, 0.5, 9.81
KINDS = ("plane", "sphere", "capsule", "mesh_collider", "distance_field")


def collider(kind: str, normal: np.ndarray, down: np.ndarray) -> dict[str, Any]:
    """A collider whose surface passes through the origin at right angles to `normal`."""
    tilted = {
        "angle": -degrees(atan(normal[0] / normal[1])),
        "axis": [0.0, 0.0, 1.0],
        "origin": (-0.2 * normal).tolist(),
    }
    slab = {"shape": {"name": "box", "sides": [4.0, 0.4, 1.0], "resolution": 8}} | tilted
    middle = -RADIUS * normal
    places: dict[str, dict[str, Any]] = {
        "plane": {"normal": normal.tolist()},
        "sphere": {"center": middle.tolist(), "radius": RADIUS},
        "capsule": {"start": (middle - 50 * down).tolist(), "end": (middle + 50 * down).tolist(), "radius": RADIUS},
        "box": {"center": [0.0, -1.0, 0.0], "half_size": [3.0, 1.0, 3.0]},
        "mesh_collider": slab,
        "distance_field": slab | {"spacing": 0.05},
    }
    rubs = {"thickness": THICKNESS, "static_friction": MU, "dynamic_friction": MU}
    return {"kind": kind} | rubs | places[kind]


def path(kind: str, ratio: float, speed: float = 0.0) -> np.ndarray:
    """Way of the centre [m] along a slope of tan a = `ratio` MU after 0.5 and 1 s, from `speed` [m/s]."""
    a = atan(ratio * MU)
    normal, down = np.array([sin(a), cos(a), 0.0]), np.array([cos(a), -sin(a), 0.0])
    cube = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [SIDE] * 3, "resolution": 4}, "edge": 0.1,
        "young_modulus": 1e6, "angle": -degrees(a), "axis": [0.0, 0.0, 1.0], "velocity": (speed * down).tolist(),
        "origin": ((SIDE / 2 + THICKNESS + 1e-9) * normal).tolist(),
    }  # fmt: skip
    method = {"solver": "xpbd", "dt": 1 / 60, "substeps": 8}
    scene = Scene(
        {"cube": cube, "floor": collider(kind, normal, down), "gravity": {"acceleration": G}, "method": method}
    )
    mass, ways = scene.tetrahedra_set.masses, []
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        for steps in (0, 30, 30):
            simulation.advance(steps)
            ways.append(mass @ simulation.state().position @ down / mass.sum())
    return np.diff(ways).cumsum()


@pytest.mark.parametrize("kind", KINDS)
def test_a_cube_sticks_below_the_limit(kind: str) -> None:
    """The first half second shears it by 5 mm; then it creeps by less than 0.2 mm/s."""
    middle, late = path(kind, 0.9)
    assert abs(late - middle) / 0.5 < 2e-4 and late < 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_a_cube_slides_above_the_limit(kind: str) -> None:
    """With g (sin a - mu cos a), as the second difference of its path has no start. The sphere falls away by 0.27 m/RADIUS
    beneath it, which makes up to g cos a (1 + mu tan a) times that."""
    a, (middle, late) = atan(1.1 * MU), path(kind, 1.1)
    expected = G * (sin(a) - MU * cos(a))
    steeper = late / RADIUS * G * cos(a) * (1 + MU * 1.1 * MU) if kind == "sphere" else 0.0
    assert -0.02 * expected < (late - 2 * middle) / 0.5**2 - expected < 0.02 * expected + steeper


def test_a_cube_stops_on_a_box() -> None:
    """Whose top is level: from 1 m/s after 1/(2 mu g), and it stays there."""
    middle, late = path("box", 0.0, speed=1.0)
    assert late == pytest.approx(1 / (2 * MU * G), rel=0.05)
    assert abs(late - middle) / 0.5 < 1e-3
