"""Contacts of tetrahedral bodies' surfaces in slow, plain NumPy float64, every vertex against every triangle: the judge of
both backends.

As bench/reference/contacts.py, which projects them, with two things that a closed surface has and a sheet has not. The side:
the nearest triangle of another body tells whether a vertex lies inside, by the way from its nearest point, which is along
the triangle's normal or against it (J. A. Baerentzen, H. Aanaes, IEEE TVCG 11 (2005), without their weighted normals: behind
is what is more than BEHIND of the way against it). And what follows: inside a body its nearest triangle alone leads out,
outside of it what is seen from behind is none.
"""

from __future__ import annotations

import numpy as np

from bench.reference.contacts import FLAT, MARGIN, Found, nearest_weights
from model.scene.scene import Scene

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


def _outward(distance: float, q: np.ndarray, r: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(inside (n,), way out (n, 3))."""
    normal = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
    side = np.einsum("nk,nk->n", normal, r)
    far = length > FLAT * distance
    inside = np.where(far, side < -BEHIND * length, side < 0)
    sign = np.where(inside, -1.0, 1.0)[:, None]
    normal[far] = (sign * r)[far] / length[far, None]
    return inside, normal


def find(scene: Scene, distance: float, before: np.ndarray, predicted: np.ndarray) -> Found:
    """What may touch within a substep from (particles, 3) `before` to `predicted` [m], of bodies that do not meet themselves:
    a triangle of another body whose nearest point is less than the distance, a margin and the largest motion of the vertex
    relative to one of its corners away, the first of those that share the feature. Nothing is attached."""
    part, bodies = scene.contact, scene.tetrahedra_set
    assert part is not None
    every, first = bodies.surface, np.append(bodies.first_particle, bodies.particle_count)
    body = np.repeat(np.arange(len(bodies.parts)), np.diff(first))
    vertex, triangle = (a.ravel() for a in np.meshgrid(np.unique(every), np.arange(len(every)), indexing="ij"))
    apart = body[vertex] != body[every[triangle, 0]]
    vertex, triangle = vertex[apart], triangle[apart]
    corners = every[triangle]
    weights = nearest_weights(before[vertex], before[corners])
    r = before[vertex] - np.einsum("nk,nkd->nd", weights, before[corners])
    length, move = np.linalg.norm(r, axis=1), predicted - before
    motion = np.linalg.norm(move[vertex][:, None] - move[corners], axis=2).max(axis=1)
    near = length < distance * (1 + MARGIN) + motion
    near[near] = _answers(every, corners[near], weights[near])
    vertex, triangle, corners, weights = vertex[near], triangle[near], corners[near], weights[near]
    r, length = r[near], length[near]
    inside, normal = _outward(distance, before[corners], r, length)
    h = scene.method.dt / scene.method.substeps
    held = np.minimum(distance, np.einsum("nk,nk->n", normal, r) + part.separation_speed * h)
    order = np.lexsort((triangle, length, vertex))
    kept: list[int] = []
    leads: dict[tuple[int, int], int] = {}
    for n in order.tolist():
        pair = int(vertex[n]), int(body[corners[n, 0]])
        if leads.setdefault(pair, n) == n or not (inside[leads[pair]] or inside[n]):
            kept.append(n)
    return Found(*(a[kept] for a in (vertex, triangle, corners, weights, normal, held, length)))
