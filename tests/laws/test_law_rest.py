"""What is at rest stays at rest: unloaded, and lying on each kind of collider."""

from __future__ import annotations

from typing import Any

import numpy as np
from lab import GRAVITY, Lab, farthest, masses, start
from law import limit_of, of
from rows import Row

from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

STEPS = 8
THICKNESS = 2.0**-6  # m
ROUND = 64.0  # m, radius of the sphere and the capsule: nearly flat beneath a row
FRICTION = {"static_friction": 0.5, "dynamic_friction": 0.5}


def collider(kind: str, height: float, middle: Any, **fields: Any) -> dict[str, Any]:
    """The table of a collider whose surface, with its thickness, is highest at `height` [m] below `middle`."""
    x, _, z = middle
    top = height - THICKNESS
    places: dict[str, dict[str, Any]] = {
        "plane": {"point": [x, top, z]},
        "sphere": {"center": [x, top - ROUND, z], "radius": ROUND},
        "capsule": {"start": [x - 8.0, top - ROUND, z], "end": [x + 8.0, top - ROUND, z], "radius": ROUND},
        "box": {"center": [x, top - 2.0, z], "half_size": [4.0, 2.0, 4.0]},
        "mesh_collider": {"shape": {"name": "box", "sides": [8.0, 1.0, 8.0], "resolution": 1}, "origin": [x, top - 0.5, z]},
        "distance_field": {
            "shape": {"name": "box", "sides": [4.0, 1.0, 4.0], "resolution": 1}, "origin": [x, top - 0.5, z], "spacing": 0.25,
        },
    }  # fmt: skip
    return {"kind": kind, "thickness": THICKNESS} | places[kind] | fields


def lying(row: Row, kind: str, friction: dict[str, float] = FRICTION, **fields: Any) -> Scene:
    """The row's body on a collider, which it touches."""
    place = build(row.scene(row.lain)).position
    middle = (place.max(axis=0) + place.min(axis=0)) / 2
    floor = collider(kind, float(place[:, 1].min()), middle, **friction, **fields)
    return row.scene(row.lain, gravity={"acceleration": GRAVITY}, floor=floor)


def sag(row: Row) -> float:
    """[m]: how far a body of some height goes down under its own weight: rho g H^2 / (2 E) of tetrahedra, and about
    as much as the goals of a cluster, g / w^2, of two layers."""
    height = float(np.ptp(build(row.scene(row.lain)).position[:, 1]))
    if height == 0 or row.name == "rigid_body":
        return 0.0
    parts = row.bare.parts.values()
    result = [
        1000.0 * GRAVITY * height**2 / (2 * part.young_modulus) for part in parts if hasattr(part, "young_modulus")
    ]
    result += [2 * GRAVITY / part.cluster_stiffness for part in parts if hasattr(part, "cluster_stiffness")]
    return max(result)


@of("rest")
def test_rest_stays_at_rest(row: Row, case: str, lab: Lab) -> None:
    """Unloaded, no force is more than rounding: each of n substeps changes velocities by `noise` at most,
    `iterations` times, so that after t nothing has moved by more than n * iterations * noise * t. A fluid on its lattice has
    no constraint to correct: all substeps together make one rounding at most (0.06 of one is the largest measured).

    What lies on a collider under gravity, with friction, has a weight that comes all at once: an undamped body goes
    down by twice its sag at most (a step load), and comes up no higher than it lay. Below the edges of a body that is
    r wide a sphere of radius R leaves a gap of r^2/(2 R), and on its slope r/R < mu friction holds it, but for g h
    r/R of creep in each substep (docs/method/grids.md, contact). Nothing goes into the collider."""
    if case == "after sliding":
        stays_after_sliding(row, lab)
        return
    scene = row.bare if case == "unloaded" else lying(row, case)
    begin = start(scene)
    state = lab.run(scene, STEPS, begin)
    h, n = row.h, STEPS * scene.method.substeps
    time = h * n
    moved = np.asarray(state.position, np.float64) - begin.position
    roundings = 1 if scene.fluids else n * (1 + scene.method.iterations)
    bound = roundings * lab.noise(scene, begin, state) * time
    if case == "unloaded":
        assert farthest(moved) <= bound
        assert farthest(state.velocity) <= roundings * lab.noise(scene, begin, state)
        return
    wide = float(np.ptp(begin.position, axis=0)[::2].max()) / 2
    gap = 2 * wide**2 / ROUND if case in ("sphere", "capsule") else 0.0
    creep = GRAVITY * h * 2 * wide / ROUND * time if case in ("sphere", "capsule") else 0.0
    limit = limit_of("rest", row)
    down = 2 * sag(row) + gap + (limit.part * GRAVITY * h**2 if limit else 0.0)
    assert moved[:, 1].min() >= -down - bound, "sinks"
    assert moved[:, 1].max() <= sag(row) + gap + bound, "rises"
    assert farthest(moved[:, ::2]) <= down + creep + bound, "slides"


def stays_after_sliding(row: Row, lab: Lab) -> None:
    """Thrown along a floor at v = 1/16 m/s a body stops after v / (mu g) = 1/64 s, two steps (the hand-out's, of half the
    weight, four); two steps later, and from then on, nothing moves but by rounding.

    What has a height is slowed from below. A rigid body turns a little on its first edge and falls back, less each
    time: it has 32 steps. An undamped body of tetrahedra sways on, and what lies on the floor stays where it is.
    Where friction acts after a solve that moved what lies there, it goes on by h^2 times what shears it, at most mu
    times the weight of all, twice as a step load, over the mass that lies there."""
    scene = lying(row, "plane")
    tall = bool(scene.tetrahedra) or row.name == "rigid_body"
    begin, steps = start(scene, velocity=[2.0**-4, 0.0, 0.0]), 32 if tall else STEPS
    states = lab.states(scene, steps, begin)
    n = steps * scene.method.substeps
    noise = n * (1 + scene.method.iterations) * lab.noise(scene, *states)
    limit, late = limit_of("rest", row), np.asarray(states[-1].position, np.float64)
    if scene.tetrahedra:
        low = begin.position[:, 1] == begin.position[:, 1].min()
        heavy = masses(begin).sum() / masses(begin)[low].sum()
        pushed = 2 * FRICTION["static_friction"] * GRAVITY * heavy * row.h**2 * 2 * scene.method.substeps
        assert farthest((late - states[-3].position)[low]) <= noise * n * row.h + (pushed if limit else 0.0)
        return
    kick = limit.part * GRAVITY * row.h if limit and not tall else 0.0
    assert farthest(states[-1].velocity) <= kick + noise
    assert farthest(late - states[-3].position) <= noise * n * row.h
