"""Velocities of a fluid's particles after a substep's corrections and at walls, in slow, plain NumPy float64.

From the description in model/fluid/plan.py, 1 and 6, without model/formulas. An impact is inelastic, unless a collider
has a restitution, and the tangential velocity stays. The velocity that a wall's push adds does not move a particle away
from that wall (J. Moreau, CISM 302, 1988).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.bench.reference import fluid_world


def velocities(
    world: Any, number: int, x: np.ndarray, u: np.ndarray, p: np.ndarray, multiplier: np.ndarray
) -> np.ndarray:
    """Return the velocities (n, 3) [m/s] of particles at p that began substep `number` at x with predicted velocity u.

    `multiplier` [m^2]: sum over all iterations.
    """
    h, change = world.h, world.of("maximum_acceleration") * world.h
    free_flight = x + h * u
    predicted, after = world.collide(number, x, free_flight, u)
    hit = (predicted != free_flight).any(axis=1)[:, None]
    v = np.where(hit, after + (p - predicted) / h, (p - x) / h)
    base = np.where(hit, after, u)
    far = np.linalg.norm(v - base, axis=1)
    v = base + (v - base) * np.where(far > change, change / np.where(far > 0, far, 1), 1)[:, None]
    return without_rebound(world, number, predicted, v, after, multiplier)


def without_rebound(
    world: Any, number: int, at: np.ndarray, v: np.ndarray, u: np.ndarray, multiplier: np.ndarray
) -> np.ndarray:
    """Return velocities v, u before the corrections, without the velocity by which walls pushed particles away from
    `at`."""
    end, total = (number + 1) * world.h, np.zeros(len(at))
    for _, collider in world.scene.colliders:
        distance, normal = fluid_world.distances(collider, at, end)
        contribution, slope = world.kernels.wall_at(distance - collider.thickness)
        push = world.weight * multiplier * slope * fluid_world.rate(contribution, total) / world.h
        wall = np.array(collider.velocity, float)
        if hasattr(collider, "spin"):  # meshes and distance fields rotate
            wall = wall + np.cross(collider.spin, at - collider.origin - wall * end)
        before = np.maximum((u * normal).sum(axis=1), (wall * normal).sum(axis=1))
        gained = (v * normal).sum(axis=1) - before
        v = v - np.clip(gained, 0, push)[:, None] * normal
        total = fluid_world.joined(total, contribution)
    return v
