"""Sampled signed distance as a collider, in slow, plain NumPy float64: weights of eight samples, mass by mass.

From the description in model/tables/colliders/distance_field.py, without model/formulas. In the body's frame a path
that enters the body ends there; then a mass nearer than the thickness is pushed along the gradient by the missing
distance, at most four times.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from softlab.model.tables.colliders.distance_field import DistanceField, Field

ROUNDS, STEPS = 4, 64
SETTLED = 1 - 1 / 64  # of the thickness: a mass that was moved and is farther away than this stays
FLAT = 1 / 1024  # a smaller slope has no direction

# (velocity, normal, surface's velocity) -> velocity
Touched = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def sample(field: Field, point: np.ndarray) -> tuple[float, np.ndarray]:
    """Return (distance [m], gradient (3,)) at a point (3,), by the weights of the samples around it.

    Outside the grid: a lower bound of the distance, and no gradient.
    """
    place, last = (point - field.low) / field.spacing, np.array(field.distance.shape) - 1
    outside = float(np.max([-place, place - last]))
    if outside > 0:
        return field.margin + outside * field.spacing, np.zeros(3)
    cell = np.minimum(np.floor(place).astype(int), last - 1)
    part, distance, gradient = place - cell, 0.0, np.zeros(3)
    for corner in product((0, 1), repeat=3):
        chosen = np.array(corner) == 1
        weight, slope = np.where(chosen, part, 1 - part), np.where(chosen, 1.0, -1.0)
        value = field.distance[tuple(cell + corner)]
        distance += weight.prod() * value
        gradient += [slope[k] * np.delete(weight, k).prod() * value for k in range(3)]
    return distance, gradient / field.spacing


def entered(field: Field, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the point (3,) where the path from p to q (3,) enters the body; q if it does not, or began inside."""
    length = float(np.linalg.norm(q - p))
    gone, old = 0.0, (0.0, np.inf)
    for _ in range(STEPS):
        distance = sample(field, p + (q - p) * (gone / length if length else 0.0))[0]
        if distance <= 0:
            if gone == 0:
                return q
            part = old[0] + (gone - old[0]) * old[1] / (old[1] - distance)
            return p + (q - p) * (part / length)
        if distance >= length - gone:
            return q
        old = gone, distance
        gone = min(gone + max(distance, field.spacing / 2), length)
    return q


def collide(
    body: DistanceField, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, begin: float, end: float,
    touched: Touched, in_place: bool = False,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return (position, velocity) (n, 3) of masses that move from `before` at time `begin` [s] to `position` at `end`.

    `in_place`: friction reverts the sliding of masses whose path did not enter the body.
    """
    field, drift, spin = body.field, np.array(body.velocity), np.array(body.spin)
    then, now = body.turn_at(begin), body.turn_at(end)
    old = (before - body.origin - drift * begin) @ then
    new = (position - body.origin - drift * end) @ now
    position, velocity = position.copy(), velocity.copy()
    low, high = field.low, field.low + field.spacing * (np.array(field.distance.shape) - 1)
    near = ((np.minimum(old, new) <= high) & (np.maximum(old, new) >= low)).all(axis=1)
    for k in np.flatnonzero(near):
        back = old[k] - new[k]
        x, v, distance_limit = entered(field, old[k], new[k]), velocity[k] @ now, body.thickness
        has_contact, cut = False, bool((x != new[k]).any())
        for _ in range(ROUNDS):
            distance, normal = sample(field, x)
            if distance >= distance_limit:
                break
            if np.linalg.norm(normal) <= FLAT:
                normal = back if back.any() else np.array([0.0, 1.0, 0.0])
            normal = normal / np.linalg.norm(normal)
            x = x + (body.thickness - distance) * normal
            answered = touched(v, normal, drift @ now + np.cross(spin, x))
            if in_place and not cut:
                x = x + (end - begin) * (answered - v - ((answered - v) @ normal) * normal)
            v, has_contact, distance_limit = answered, True, SETTLED * body.thickness
        if has_contact:
            position[k], velocity[k] = now @ x + body.origin + drift * end, now @ v
    return position, velocity
