"""Contacts of surfaces of tetrahedral bodies, and of a cloth beside them, in slow, plain NumPy float64, every vertex against
every triangle: the judge of both backends.

As self_contacts.py, which projects them, with two things that a closed surface has and a sheet has not. The side: the
nearest triangle of another body tells whether a vertex lies inside, by the way from its nearest point, which is along the
triangle's normal or against it (J. A. Baerentzen, H. Aanaes, IEEE TVCG 11 (2005), without their weighted normals: behind is
what is more than BEHIND of the way against it). And what follows: inside a body its nearest triangle alone leads out,
outside of it what is seen from behind is none. A cloth has neither: a vertex is held on the side where it is.
"""

from __future__ import annotations

import numpy as np

from bench.reference.contact.self_contacts import FLAT, MARGIN, Found, nearest_weights
from model.scene.scene import Scene
from model.tetrahedra.attachments import attachment_sets

BEHIND = 0.25


def _answers(every: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n,) bool: whether a triangle is the first of all that have its corners of non-zero weight."""
    holders: dict[int, set[int]] = {}
    for number, own in enumerate(every.tolist()):
        for vertex in own:
            holders.setdefault(vertex, set()).add(number)
    result = np.zeros(len(corners), bool)
    for n, (own, weight) in enumerate(zip(corners.tolist(), weights, strict=True)):
        feature = [vertex for vertex, w in zip(own, weight, strict=True) if w > 0]
        result[n] = every[min(set.intersection(*(holders[vertex] for vertex in feature)))].tolist() == own
    return result


def _outward(
    distance: np.ndarray, q: np.ndarray, r: np.ndarray, length: np.ndarray, closed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(inside (n,), way out (n, 3)); `distance` (n,) [m]; `closed` (n,): of a surface that has an inside."""
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


def find(scene: Scene, distance: float, before: np.ndarray, predicted: np.ndarray) -> Found:
    """What may touch within a substep from (particles, 3) `before` to `predicted` [m], of bodies that do not meet themselves:
    a triangle of another body whose nearest point is less than the distance, a margin and the largest motion of the vertex
    relative to one of its corners away, the first of those that share the feature. Where bodies are attached to one another,
    triangles are left out."""
    part, bodies = scene.contact, scene.tetrahedra_set
    assert part is not None
    first = np.append(bodies.first_particle, bodies.particle_count)
    body = np.repeat(np.arange(len(bodies.names)), np.diff(first))
    joined = [rows.corners.ravel() for rows in attachment_sets(bodies) if rows.corners.shape[1] > 1]
    every = bodies.surface[~np.isin(bodies.surface, np.concatenate([[], *joined])).any(axis=1)]
    vertex, triangle = (a.ravel() for a in np.meshgrid(np.unique(every), np.arange(len(every)), indexing="ij"))
    apart = body[vertex] != body[every[triangle, 0]]
    closed = np.arange(len(bodies.names)) < len(bodies.parts)
    kept = np.full(len(body), distance)
    h = scene.method.dt / scene.method.substeps
    return among(
        every, vertex[apart], triangle[apart], body, closed, kept, part.separation_speed * h, before, predicted
    )


def among(
    every: np.ndarray, vertex: np.ndarray, triangle: np.ndarray, body: np.ndarray, is_closed: np.ndarray,
    distance: np.ndarray, push: float, before: np.ndarray, predicted: np.ndarray,
) -> Found:  # fmt: skip
    """`find`, of pairs of a `vertex` (n,) and a `triangle` (n,) of `every` (triangles, 3): particles. `body` (particles,);
    `is_closed` (bodies,) bool: which have an inside; `distance` (particles,) [m]: what a vertex keeps; `push` [m]: how far an
    overlap is undone."""
    corners = every[triangle]
    weights = nearest_weights(before[vertex], before[corners])
    r = before[vertex] - np.einsum("nk,nkd->nd", weights, before[corners])
    length, move = np.linalg.norm(r, axis=1), predicted - before
    motion = np.linalg.norm(move[vertex][:, None] - move[corners], axis=2).max(axis=1)
    near = length < distance[vertex] * (1 + MARGIN) + motion
    near[near] = _answers(every, corners[near], weights[near])
    vertex, triangle, corners, weights = vertex[near], triangle[near], corners[near], weights[near]
    r, length = r[near], length[near]
    inside, normal = _outward(distance[vertex], before[corners], r, length, is_closed[body[corners[:, 0]]])
    held = np.minimum(distance[vertex], np.einsum("nk,nk->n", normal, r) + push)
    order = np.lexsort((triangle, length, vertex))
    kept: list[int] = []
    leads: dict[tuple[int, int], int] = {}
    for n in order.tolist():
        pair = int(vertex[n]), int(body[corners[n, 0]])
        if leads.setdefault(pair, n) == n or not (inside[leads[pair]] or inside[n]):
            kept.append(n)
    return Found(*(a[kept] for a in (vertex, triangle, corners, weights, normal, held, length)))
