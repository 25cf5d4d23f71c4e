"""Small scenes of soft and rigid bodies, squashed, thrown at each other, stacked, heaped, and their measures.

All scenes have the same parts, some of them switched off or far away, so that kernels are compiled once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softlab.model.base.table import Table
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

GRAVITY = 9.81  # m/s^2
AWAY = {"point": [0.0, -1e5, 0.0], "normal": [0.0, 1.0, 0.0], "static_friction": 0.5, "dynamic_friction": 0.4}
FLOOR = AWAY | {"point": [0.0, 0.0, 0.0]}
SAMPLED = {"shape": {"name": "beam"}, "surface_sampling": 0.0, "volume_sampling": 1.0}
SEPARATION = 1.0  # m/s
CONTACT = {"maximum_speed": 1e3, "sleeping_speed": 1e-30, "adhesion_reach": 0.0, "separation_speed": SEPARATION}
SPACING, RIGID_SPACING = 0.16, 0.125  # m
SOFT = {"kind": "soft_body", "particle_spacing": SPACING, "adhesion": 1e-30, **SAMPLED}  # 24 particles, 3 clusters
BRICK = {"kind": "rigid_body", "particle_spacing": RIGID_SPACING, "adhesion": 1e-30, **SAMPLED}  # 32 in two layers
BRICK_HEIGHT = 0.25  # m
TILTED = {"angle": 30.0, "axis": [0.3, 0.2, 1.0]}
ULP = {"float64": 2.0**-53, "float32": 2.0**-24}  # rounding error of 1

SPEED = 100.0  # m/s: of a body thrown at a wall
FALL = 10.0  # m/s: above any speed of fall here, sqrt(2 g 3.9 m)

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

# ---------------------------------------------------------------------- scenes


def method(substeps: int = 1, iterations: int = 1, dt: float = 0.01) -> Table:
    """Return the fields of a scene's [method]; `dt` [s]."""
    return {"solver": "shape-matching", "dt": dt, "substeps": substeps, "iterations": iterations}


def bodies_scene(*, gravity: float = 9.81, damping: float = 0.0, plane: Table = AWAY, **tables: Any) -> Scene:
    """Return a scene of bodies; `tables`: bodies and the method."""
    world = {"gravity": {"acceleration": gravity}, "damping": {"coefficient": damping}, "plane": plane}
    return Scene(world | {"method": method()} | tables, "bodies")


def meeting(gravity: float = 0.0, substeps: int = 1, iterations: int = 1, dt: float = 0.01, **tables: Any) -> Scene:
    """Return a scene of bodies in contact; `contact`: fields of that part."""
    contact = CONTACT | tables.pop("contact", {})
    return bodies_scene(gravity=gravity, contact=contact, method=method(substeps, iterations, dt), **tables)


def alone(kind: Table) -> Table:
    """Return the body without contacts between bodies, which compiles in a third of the time."""
    return {name: value for name, value in kind.items() if name != "adhesion"}


def thrown_at_a_plane(body: Table, substeps: int = 1) -> Scene:
    """Return a scene with a tilted body that is thrown down from 1 m above a plane."""
    shot_down = TILTED | {"velocity": [0.0, -SPEED, 0.0], "origin": [0.0, 1.0, 0.0]}
    return meeting(substeps=substeps, plane=FLOOR, body=body | shot_down)


def thrown_at_a_box(substeps: int = 4) -> Scene:
    """Return a brick thrown at a box from 0.1 m above it; a distant ball keeps the kernel the same."""
    box = {"kind": "box", "center": [0.0, -0.5, 0.0], "half_size": [2.0, 0.5, 2.0]}
    return bodies_scene(
        gravity=0.0, method=method(substeps), box=box, sphere={"kind": "sphere", "center": [0.0, 1e5, 0.0], "radius": 1.0},
        body=alone(BRICK) | {"velocity": [0.0, -SPEED, 0.0], "origin": [0.0, 0.2, 0.0]},
    )  # fmt: skip


def shot(part: float, kind: Table, angle: float, aside: float, contact: dict[str, float] | None = None) -> Scene:
    """Return a body thrown at a rigid brick at rest, in substeps of `part` of the distance that particles keep."""
    distance = (kind["particle_spacing"] + RIGID_SPACING) / 2
    bullet = kind | {"velocity": [0.0, -SPEED, 0.0], "origin": [aside, 0.6, -aside / 2], "angle": angle}
    bullet |= {"axis": [0.2, -0.5, 1.0]}
    return meeting(dt=part * distance / SPEED, wall=BRICK, bullet=bullet, contact=contact or {})


def inside_each_other(one: Table, other: Table, aside: Sequence[float], iterations: int = 1) -> Scene:
    """Return a scene in which one body begins inside the other, `aside` [m] off its centre."""
    return meeting(iterations=iterations, one=one | {"origin": list(aside)}, other=other)


def ball_in_a_body() -> Scene:
    """Return a scene with a ball in the lower side of a body; a distant box keeps the kernel the same."""
    ball = {"kind": "sphere", "center": [0.0, -0.16, 0.0], "radius": 0.15, "thickness": 0.01}
    far = {"kind": "box", "center": [0.0, 1e5, 0.0]}
    return bodies_scene(gravity=0.0, method=method(4), sphere=ball, box=far, body=alone(SOFT))


def stack(substeps: int, iterations: int = 1, bricks: int = 10, contact: dict[str, float] | None = None) -> Scene:
    """Return a stack of bricks of 32 particles each, in two layers of sixteen."""
    brick = BRICK | {"origin": [0.0, 0.125, 0.0], "copies": [1, bricks, 1], "apart": [1.0, BRICK_HEIGHT, 1.0]}
    return meeting(
        GRAVITY,
        substeps,
        iterations,
        brick=brick,
        plane=FLOOR | {"thickness": RIGID_SPACING / 2},
        contact=contact or {},
    )


def load(ratio: float, substeps: int) -> Scene:
    """Return a brick on a brick, `ratio` times as heavy."""
    lower = BRICK | {"origin": [0.0, 0.125, 0.0]}
    upper = BRICK | {"origin": [0.0, 0.125 + BRICK_HEIGHT, 0.0], "density": 1000.0 * ratio}
    return meeting(GRAVITY, substeps, lower=lower, upper=upper, plane=FLOOR | {"thickness": RIGID_SPACING / 2})


def heap(copies: int, substeps: int, separation_speed: float = FALL) -> Scene:
    """Return jellies dropped on each other. Contacts separate at the speed of the fall, so that caught particles show."""
    body = SOFT | TILTED | {"origin": [0.0, 0.75, 0.0], "copies": [1, copies, 1], "apart": [1.0, 0.45, 1.0]}
    plane, contact = FLOOR | {"thickness": SPACING / 2}, {"separation_speed": separation_speed}
    return meeting(GRAVITY, substeps, soft=body, plane=plane, contact=contact)


# ---------------------------------------------------------------------- states and their measures


def start(
    scene: Scene,
    position: ArrayLike | None = None,
    velocity: ArrayLike | None = None,
    rotation: np.ndarray | None = None,
) -> State:
    """Return a state at time 0: the scene's, with the given arrays replaced."""
    body_set = scene.body_set
    position = body_set.position if position is None else np.asarray(position, dtype=np.float64)
    velocity = np.zeros_like(position) if velocity is None else np.asarray(velocity, dtype=np.float64)
    return State(position, velocity, 1 / body_set.clusters.mass, 0.0, 0, rotation=rotation)


def masses(scene: Scene) -> np.ndarray:
    """Masses of the particles, (particles, 1) [kg]."""
    m: np.ndarray = scene.body_set.clusters.mass[:, None]
    return m


def centre(scene: Scene, values: np.ndarray, body: int | None = None) -> np.ndarray:
    """Return the mean by mass of a body's values, or of all bodies' (None): (3,)."""
    chosen = scene.body_set.body == body if body is not None else np.ones(len(values), bool)
    m = masses(scene)[chosen]
    mean: np.ndarray = (m * values[chosen]).sum(axis=0) / m.sum()
    return mean


def kinetic(scene: Scene, velocity: np.ndarray) -> float:
    """Kinetic energy [J]."""
    return 0.5 * float((masses(scene) * velocity.astype(float) ** 2).sum())


def changed(scene: Scene, change: Change) -> State:
    """Return the scene's state at rest, deformed about its centre by `change`."""
    middle = centre(scene, scene.body_set.position)
    return start(scene, change(scene.body_set.position - middle) + middle)


def out_of_shape(scene: Scene, position: np.ndarray) -> float:
    """Return the largest distance [m] of a particle from its position in its body, each body in its best-fit rotation
    (det +1).
    """
    worst = 0.0
    for body in range(len(scene.body_set.copies)):
        chosen, m = scene.body_set.body == body, masses(scene)[scene.body_set.body == body]
        now = position[chosen] - centre(scene, position, body)
        rest = scene.body_set.position[chosen] - centre(scene, scene.body_set.position, body)
        u, _, v = np.linalg.svd((m * now).T @ rest)
        turn = u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(v)]) @ v
        worst = max(worst, float(np.abs(now - rest @ turn.T).max()))
    return worst


def nearest(scene: Scene, position: np.ndarray) -> float:
    """Return the smallest distance [m] between particles of two bodies."""
    body = scene.body_set.body
    apart = np.linalg.norm(position[:, None] - position, axis=2)
    return float(apart[body[:, None] != body].min())


def sunk(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return (bodies,): by how much the centre of each came nearer to the body below, over g h^2."""
    h = scene.method.dt / scene.method.substeps
    fallen = [centre(scene, scene.body_set.position - position, body)[1] for body in range(len(scene.body_set.copies))]
    sinking: np.ndarray = np.diff([0.0, *fallen]) / (GRAVITY * h * h)
    return sinking
