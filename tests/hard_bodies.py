"""Small bodies in hard cases: squashed, shot at each other, stacked, heaped; and what is measured of them.

All scenes have the same parts, some of them next to nothing, so that kernels are compiled once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from bodies_scenes import AWAY, SAMPLED, bodies_scene, method, start

from model.scene import Scene
from model.simulation import State

GRAVITY = 9.81  # m/s^2
SEPARATION = 1.0  # m/s
MEET = {"maximum_speed": 1e3, "sleeping_speed": 1e-30, "adhesion_reach": 0.0, "separation_speed": SEPARATION}
SPACING, RIGID_SPACING = 0.16, 0.125  # m
SOFT = {"kind": "soft_body", "particle_spacing": SPACING, "adhesion": 1e-30, **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": RIGID_SPACING, "adhesion": 1e-30, **SAMPLED}  # 32 in two layers
TILTED = {"angle": 30.0, "axis": [0.3, 0.2, 1.0]}
FLOOR = AWAY | {"point": [0.0, 0.0, 0.0]}
ULP = {"float64": 2.0**-53, "float32": 2.0**-24}

SPEED = 100.0  # m/s: of what is shot at a wall
FALL = 10.0  # m/s: faster than anything falls here, sqrt(2 g 3.9 m)

Change = Callable[[np.ndarray], np.ndarray]
SQUASHED: dict[str, Change] = {
    "into a plane": lambda p: p * [0, 1, 1],
    "into its own plane": lambda p: p * [1, 0, 1],
    "onto its axis": lambda p: p * [1, 0, 0],
    "onto a line across": lambda p: p * [0, 1, 0],
    "into a point": lambda p: p * 0,
}
MIRRORED: dict[str, Change] = {"mirrored": lambda p: p * [-1, 1, 1], "inside out": lambda p: -p}
CHANGED = SQUASHED | MIRRORED


def meeting(gravity: float = 0.0, substeps: int = 1, iterations: int = 1, dt: float = 0.01, **tables: Any) -> Scene:
    contact = MEET | tables.pop("contact", {})
    return bodies_scene(gravity=gravity, contact=contact, method=method(substeps, iterations, dt), **tables)


def masses(scene: Scene) -> np.ndarray:
    m: np.ndarray = scene.crowd.clusters.mass[:, None]
    return m


def centre(scene: Scene, values: np.ndarray, body: int | None = None) -> np.ndarray:
    """(3,): the mean by mass of a body's values, or of all."""
    chosen = scene.crowd.body == body if body is not None else np.ones(len(values), bool)
    m = masses(scene)[chosen]
    found: np.ndarray = (m * values[chosen]).sum(axis=0) / m.sum()
    return found


def kinetic(scene: Scene, velocity: np.ndarray) -> float:
    """[J]"""
    return 0.5 * float((masses(scene) * velocity.astype(float) ** 2).sum())


def changed(scene: Scene, change: Change) -> State:
    """At rest, but squashed about its centre."""
    middle = centre(scene, scene.crowd.position)
    return start(scene, change(scene.crowd.position - middle) + middle)


def out_of_shape(scene: Scene, position: np.ndarray) -> float:
    """How far [m] the worst particle is from its place in its body, each body turned as it fits best (det +1)."""
    worst = 0.0
    for body in range(len(scene.crowd.copies)):
        chosen, m = scene.crowd.body == body, masses(scene)[scene.crowd.body == body]
        now = position[chosen] - centre(scene, position, body)
        rest = scene.crowd.position[chosen] - centre(scene, scene.crowd.position, body)
        u, _, v = np.linalg.svd((m * now).T @ rest)
        turn = u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(v)]) @ v
        worst = max(worst, float(np.abs(now - rest @ turn.T).max()))
    return worst


def nearest(scene: Scene, position: np.ndarray) -> float:
    """The least distance [m] between particles of two bodies."""
    body = scene.crowd.body
    apart = np.linalg.norm(position[:, None] - position, axis=2)
    return float(apart[body[:, None] != body].min())


def shot(part: float, kind: dict[str, Any], angle: float, aside: float, **contact: float) -> Scene:
    """At a rigid brick at rest, in substeps of `part` of the distance that particles keep."""
    distance = (kind["particle_spacing"] + RIGID_SPACING) / 2
    bullet = kind | {"velocity": [0.0, -SPEED, 0.0], "origin": [aside, 0.6, -aside / 2], "angle": angle}
    return meeting(dt=part * distance / SPEED, wall=BRICK, bullet=bullet | {"axis": [0.2, -0.5, 1.0]}, contact=contact)


def stack(substeps: int, iterations: int = 1, bricks: int = 10, **contact: float) -> Scene:
    """Of 32 particles each, sixteen on sixteen."""
    brick = BRICK | {"origin": [0.0, 0.125, 0.0], "copies": [1, bricks, 1], "apart": [1.0, 0.25, 1.0]}
    return meeting(
        GRAVITY, substeps, iterations, brick=brick, plane=FLOOR | {"thickness": RIGID_SPACING / 2}, contact=contact
    )


def heap(copies: int, substeps: int, separation_speed: float = FALL) -> Scene:
    """Jellies dropped on each other. Contacts part at the speed of the fall: see what stays caught."""
    body = SOFT | TILTED | {"origin": [0.0, 0.75, 0.0], "copies": [1, copies, 1], "apart": [1.0, 0.45, 1.0]}
    plane, contact = FLOOR | {"thickness": SPACING / 2}, {"separation_speed": separation_speed}
    return meeting(GRAVITY, substeps, soft=body, plane=plane, contact=contact)
