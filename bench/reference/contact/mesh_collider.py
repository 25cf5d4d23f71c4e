"""Mesh as a collider, in slow, plain NumPy float64: all triangles for each mass, without a tree.

From the description in model/tables/colliders/mesh_collider.py, without model/formulas. In the mesh's frame the first
triangle between the previous and the new place of a mass puts it at the thickness on the side it came from; otherwise the
nearest point pushes it out to there. At most four times; a mass whose path still crosses a triangle then stays where it
was.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.model.tables.colliders.mesh_collider import MeshCollider

ROUNDS = 4
SETTLED = 1 - 1 / 64  # of the thickness: a mass that was moved and is farther away than this stays
EDGE = 1e-12  # of a triangle's coordinates: distance from its edge that counts as on it

# (velocity, normal, surface's velocity) -> velocity
Touched = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def first_crossing(corners: np.ndarray, p: np.ndarray, q: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Return (fraction of the path from p to q (3,), unit normal (3,) on p's side) at the first of `corners` (n, 3, 3)."""
    a, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(one, two)
    before, after = (((point - a) * normal).sum(axis=1) for point in (p, q))
    crossed = (before >= 0) != (after >= 0)
    part = np.where(crossed, before / np.where(crossed, before - after, 1), np.inf)
    place = p + np.where(crossed, part, 0)[:, None] * (q - p) - a
    square = (normal**2).sum(axis=1)
    u = (np.cross(place, two) * normal).sum(axis=1) / square
    v = (np.cross(one, place) * normal).sum(axis=1) / square
    part = np.where((np.minimum(u, v) >= -EDGE) & (u + v <= 1 + EDGE), part, np.inf)
    k = int(part.argmin())
    if part[k] == np.inf:
        return None
    side = 1 if before[k] >= 0 else -1
    return float(part[k]), side * normal[k] / np.sqrt(square[k])


def nearest_point(corners: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the point (3,) of all triangles `corners` (n, 3, 3) nearest to q (3,)."""
    a, one, two = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(one, two)
    square = (normal**2).sum(axis=1, keepdims=True)
    foot = q - ((q - a) * normal).sum(axis=1, keepdims=True) / square * normal
    u = (np.cross(foot - a, two) * normal).sum(axis=1) / square[:, 0]
    v = (np.cross(one, foot - a) * normal).sum(axis=1) / square[:, 0]
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    places = [np.where(inside[:, None], foot, np.inf)]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = corners[:, end] - corners[:, start]
        part = ((q - corners[:, start]) * edge).sum(axis=1) / (edge**2).sum(axis=1)
        places.append(corners[:, start] + np.clip(part, 0, 1)[:, None] * edge)
    all_places = np.concatenate(places)
    nearest: np.ndarray = all_places[((all_places - q) ** 2).sum(axis=1).argmin()]
    return nearest


def collide(
    mesh: MeshCollider, before: np.ndarray, position: np.ndarray, velocity: np.ndarray, begin: float, end: float,
    touched: Touched, in_place: bool = False,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return (position, velocity) (n, 3) of masses that move from `before` at time `begin` [s] to `position` at `end`.

    `in_place`: friction reverts the sliding of masses that the nearest point pushed out.
    """
    corners, drift, spin = mesh.position[mesh.triangles], np.array(mesh.velocity), np.array(mesh.spin)
    then, now = mesh.turn_at(begin), mesh.turn_at(end)
    old = (before - mesh.origin - drift * begin) @ then
    new = (position - mesh.origin - drift * end) @ now
    position, velocity = position.copy(), velocity.copy()
    low, high = corners.min(axis=(0, 1)) - mesh.thickness, corners.max(axis=(0, 1)) + mesh.thickness
    near = ((np.minimum(old, new) <= high) & (np.maximum(old, new) >= low)).all(axis=1)
    for k in np.flatnonzero(near):
        x, v, has_contact = new[k], velocity[k] @ now, False
        for attempt in range(ROUNDS + 1):
            limit = mesh.thickness * (SETTLED if attempt else 1)
            crossed, last = first_crossing(corners, old[k], x), attempt == ROUNDS
            if crossed and last:
                x = old[k]
                v, has_contact = drift @ now + np.cross(spin, x), True
                break
            if crossed:
                part, normal = crossed
                x = old[k] + part * (x - old[k]) + mesh.thickness * normal
            else:
                nearest = nearest_point(corners, x)
                distance = np.linalg.norm(x - nearest)
                if last or not 0 < distance < limit:
                    break
                normal = (x - nearest) / distance
                x = nearest + mesh.thickness * normal
            answered = touched(v, normal, drift @ now + np.cross(spin, x))
            if in_place and not crossed:
                x = x + (end - begin) * (answered - v - ((answered - v) @ normal) * normal)
            v, has_contact = answered, True
        if has_contact:
            position[k], velocity[k] = now @ x + mesh.origin + drift * end, now @ v
    return position, velocity
