"""Contacts of the surfaces of tetrahedral bodies and of a cloth beside them, in slow, plain NumPy float64.

Every vertex against every triangle: the reference of both backends. Like self_contacts.py, which projects them, with
two additions for closed surfaces. The side: a vertex lies inside another body if the vector from its nearest point on
the body's nearest triangle is against that triangle's normal (J. A. Baerentzen, H. Aanaes, IEEE TVCG 11 (2005), without
their weighted normals: against it by more than BEHIND of the vector's length). The consequence: inside a body only its
nearest triangle leads out, and outside of it a triangle that is seen from behind is not a contact. A cloth has neither:
a vertex stays on its side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softlab.bench.reference.contact.self_contacts import (
    FLAT,
    MARGIN,
    VertexContacts,
    first_with_feature,
    nearest_weights,
)
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.attachments import attachment_sets

BEHIND = 0.25
# added to a corner's weight when its particle's mass is split, so that levers act where the weight is 0
EXTRA_WEIGHT = 0.25
PARALLEL = 0.99999  # cosine of a contact's normal with the triangle's, above which it is the triangle's
PAST = 2.0**-10  # of a triangle: margin beyond its edges within which a path through its plane is one through it


@dataclass(frozen=True)
class Touching(VertexContacts):
    """Contacts of surfaces; `around` (n,) object: (m, 3) int, corners of triangles with one of the triangle's corners."""

    around: np.ndarray


def _heights(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (n, 4): weights of the corners of triangles (n, 3, 3) at the foot of p (n, 3), and the height [m] of p."""
    u, v, r = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0], p - q[:, 0]
    normal = np.cross(u, v)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    height = (normal * r).sum(axis=1)
    edges = np.stack([u, v], axis=2)
    coordinates = np.einsum("nij,nj->ni", np.linalg.pinv(edges), r) if len(r) else np.zeros((0, 2))
    return np.column_stack([1 - coordinates.sum(axis=1), coordinates, height])


def _passed(early: np.ndarray, late: np.ndarray, old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return a mask (n,): a point from `early` to `late` (3,) passed the triangles from `old` to `new` (n, 3, 3)."""
    first, last = (_heights(np.broadcast_to(p, (len(q), 3)), q) for p, q in ((early, old), (late, new)))
    with np.errstate(divide="ignore", invalid="ignore"):
        part = first[:, 3:] / (first[:, 3:] - last[:, 3:])
        at = first[:, :3] + part * (last[:, :3] - first[:, :3])
    return ((first[:, 3] >= 0) != (last[:, 3] >= 0)) & (at >= -PAST).all(axis=1)


def depth(contacts: Touching, r: np.ndarray, before: np.ndarray, now: np.ndarray, deep: np.ndarray) -> np.ndarray:
    """Return the remaining part of the planes' depth `deep` with the triangles at `now`: (n,) [m].

    It is at most what the vertex lacks of the distance from its triangle, unless the vertex began inside (`r`, at the
    beginning of the substep, against the normal), or came through one of the triangles around. Beside a triangle whose
    own normal is the contact's, the distance is that from the nearest one around.
    """
    old, new = before[contacts.corners], now[contacts.corners]
    normal = np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0])
    from_triangle = np.abs((contacts.normal * normal).sum(axis=1)) >= PARALLEL * np.linalg.norm(normal, axis=1)
    beside = from_triangle & (_heights(now[contacts.mass], new)[:, :3] < 0).any(axis=1)
    result = deep.copy()
    for n in np.flatnonzero((deep > 0) & ((contacts.normal * r).sum(axis=1) > 0)):
        vertex, near = contacts.mass[n], contacts.around[n]
        if beside[n] or deep[n] > contacts.required[n]:
            if _passed(before[vertex], now[vertex], before[near], now[near]).any():
                continue
        triangles = now[near] if beside[n] else new[n : n + 1]
        p = np.broadcast_to(now[vertex], (len(triangles), 3))
        feet = np.einsum("nk,nkd->nd", nearest_weights(p, triangles), triangles)
        result[n] = min(deep[n], contacts.required[n] - np.linalg.norm(p - feet, axis=1).min())
    return result


def force_matrices(corners: np.ndarray, weights: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return matrices A_k (n, 3, 3, 3) of each corner, which gets A_k f of a force f acting at offset `r` (n, 3) [m].

    The offset is from the triangle's point with the `weights` (n, 3). The corner forces add up to f and have its
    moment, unless r is longer than the height of the triangle `corners` (n, 3, 3), which reduces the moment.
    """
    result = weights[:, :, None, None] * np.eye(3)
    for n, (q, offset) in enumerate(zip(corners, r, strict=True)):
        normal = np.cross(q[1] - q[0], q[2] - q[0])
        size, far = np.linalg.norm(normal), float(offset @ offset)
        if size == 0 or far == 0:
            continue
        normal = normal / size
        gradients = np.linalg.pinv(np.column_stack([q[1] - q[0], q[2] - q[0]]))  # of the second and third weight
        across = np.eye(3) - np.outer(offset, offset) / far
        limit = max(1.0, float(np.sqrt(far) * np.linalg.norm(gradients, axis=1).max()))
        for k, gradient in enumerate(gradients, start=1):
            lever = (gradient @ offset * across - (normal @ offset) * np.outer(normal, gradient @ across)) / limit
            result[n, k] += lever
            result[n, 0] -= lever
    return result


def rub(
    part: Any, contacts: VertexContacts, before: np.ndarray, position: np.ndarray, weight: np.ndarray, deep: np.ndarray
) -> np.ndarray:
    """Return particles' displacements (particles, 3) by the `contacts` of depth `deep` [m], for a weight of 1.

    A particle's mass is split among its contacts. The normal impulse of each contact acts first, at the triangle's
    point. Then friction acts against the remaining slip at that point, as much as stops it, or as Coulomb's law allows.
    """
    parts = contacts.weights + EXTRA_WEIGHT
    load = np.zeros(len(position))
    np.add.at(load, contacts.mass, 1.0)
    np.add.at(load, contacts.corners, parts)
    moved, split = np.zeros_like(position), weight * load
    matrices = force_matrices(
        position[contacts.corners], contacts.weights,
        position[contacts.mass] - np.einsum("nk,nkd->nd", contacts.weights, position[contacts.corners]),
    )  # fmt: skip
    for n, (vertex, corners) in enumerate(zip(contacts.mass, contacts.corners, strict=True)):
        masses = split[corners] / parts[n]
        bound = split[vertex] + masses @ contacts.weights[n] ** 2
        if bound == 0:
            continue
        press, normal = deep[n] / bound, contacts.normal[n]
        corner_motion = position[corners] - before[corners] - np.outer(masses * contacts.weights[n] * press, normal)
        slip = position[vertex] - before[vertex] - np.einsum("kdc,kd->c", matrices[n], corner_motion)
        slip = slip - (slip @ normal) * normal
        each = matrices[n] @ slip
        yielding = split[vertex] * (slip @ slip) + masses @ (each**2).sum(axis=1)
        stops = slip @ slip / yielding if yielding > 0 else 0.0
        asked = stops * float(np.linalg.norm(slip))
        if asked > part.static_friction * press:
            stops *= part.dynamic_friction * press / asked
        moved[vertex] += press * normal - stops * slip
        moved[corners] -= np.outer(contacts.weights[n] * press, normal) - stops * each
    return moved


def _outward(
    distance: np.ndarray, q: np.ndarray, r: np.ndarray, length: np.ndarray, closed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (inside (n,), direction out (n, 3)); `distance` (n,) [m]; `closed` (n,): the surface has an inside."""
    normal = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
    side = np.einsum("nk,nk->n", normal, r)
    far = length > FLAT * distance
    inside = np.where(far, side < -BEHIND * length, side < 0) & closed
    sign = np.where(inside, -1.0, 1.0)[:, None]
    normal[~closed & (side < 0)] *= -1
    normal[far] = (sign * r)[far] / length[far, None]
    return inside, normal


def find(scene: Scene, distance: float, before: np.ndarray, predicted: np.ndarray) -> Touching:
    """Return the possible contacts within a substep from `before` to `predicted` (particles, 3) [m].

    Bodies have no contact with themselves. A contact is a triangle of another body whose nearest point is nearer than
    the distance, a margin and the largest motion of the vertex relative to one of its corners; of triangles that share
    the feature only the first. Triangles at attachments between bodies are left out.
    """
    part, bodies = scene.contact, scene.tetrahedra_set
    assert part is not None
    first = np.append(bodies.first_particle, bodies.particle_count)
    body = np.repeat(np.arange(len(bodies.names)), np.diff(first))
    joined = [rows.corners.ravel() for rows in attachment_sets(bodies) if rows.corners.shape[1] > 1]
    every = bodies.surface[~np.isin(bodies.surface, np.concatenate([[], *joined])).any(axis=1)]
    vertex, triangle = (a.ravel() for a in np.meshgrid(np.unique(every), np.arange(len(every)), indexing="ij"))
    apart = body[vertex] != body[every[triangle, 0]]
    closed = np.arange(len(bodies.names)) < len(bodies.parts)
    required = np.full(len(body), distance)
    h = scene.method.dt / scene.method.substeps
    return among(
        every, vertex[apart], triangle[apart], body, closed, required, part.separation_speed * h, before, predicted
    )


def among(
    every: np.ndarray, vertex: np.ndarray, triangle: np.ndarray, body: np.ndarray, is_closed: np.ndarray,
    distance: np.ndarray, push: float, before: np.ndarray, predicted: np.ndarray,
) -> Touching:  # fmt: skip
    """Return the contacts like `find`, for pairs of a `vertex` (n,) and a `triangle` (n,) of `every` (triangles, 3).

    `body` (particles,); `is_closed` (bodies,): whether the body has an inside; `distance` (particles,) [m]: required of
    a vertex; `push` [m]: how far an overlap is reverted.
    """
    corners = every[triangle]
    weights = nearest_weights(before[vertex], before[corners])
    r = before[vertex] - np.einsum("nk,nkd->nd", weights, before[corners])
    length, move = np.linalg.norm(r, axis=1), predicted - before
    motion = np.linalg.norm(move[vertex][:, None] - move[corners], axis=2).max(axis=1)
    near = length < distance[vertex] * (1 + MARGIN) + motion
    near[near] = first_with_feature(every, corners[near], weights[near])
    vertex, triangle, corners, weights = vertex[near], triangle[near], corners[near], weights[near]
    r, length = r[near], length[near]
    inside, normal = _outward(distance[vertex], before[corners], r, length, is_closed[body[corners[:, 0]]])
    required = np.minimum(distance[vertex], np.einsum("nk,nk->n", normal, r) + push)
    order = np.lexsort((triangle, length, vertex))
    selected: list[int] = []
    leads: dict[tuple[int, int], int] = {}
    for n in order.tolist():
        pair = int(vertex[n]), int(body[corners[n, 0]])
        if leads.setdefault(pair, n) == n or not (inside[leads[pair]] or inside[n]):
            selected.append(n)
    around = np.empty(len(selected), object)
    for at, n in enumerate(selected):
        around[at] = every[np.isin(every, corners[n]).any(axis=1)]
    return Touching(*[*(a[selected] for a in (vertex, triangle, corners, weights, normal, required, length)), around])
