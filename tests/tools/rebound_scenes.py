"""Rigid bodies that fall on a floor that gives back, for the tests of rebounds on both backends."""

from __future__ import annotations

from typing import Any

from bodies_scenes import SAMPLED, bodies_scene, method
from meeting_bodies import meeting

from softlab.model.scene.scene import Scene

BRICK = {"kind": "rigid_body", "particle_spacing": 0.14, **SAMPLED}  # 28 particles
FLOOR = {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "thickness": 0.0, "static_friction": 1e-30}


def dropped(
    restitution: float, angle: float = 0.0, height: float = 1.0, speed: float = 0.0, dt: float = 0.01, **floor: Any
) -> Scene:
    """A brick whose middle is at `height` [m], turned by `angle` [degrees] about no axis of its own; down at `speed`."""
    brick = BRICK | {
        "origin": [0.0, height, 0.0], "angle": angle, "axis": [1.0, 0.3, 1.0], "velocity": [0.0, -speed, 0.0],
    }  # fmt: skip
    return bodies_scene(brick=brick, plane=FLOOR | {"restitution": restitution} | floor, method=method(2, 1, dt))


def among_soft_ones() -> Scene:
    """A brick at 5 m/s beside a soft bar and on its way into the floor, both of which give back."""
    scene = meeting(2, 1, restitution=0.5)
    return scene.replace(
        {"plane.restitution": 0.6, "brick.origin": [0.5, 0.15, 0.0], "brick.velocity": [0.0, -5.0, 0.4]}
    )
