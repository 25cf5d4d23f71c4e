"""Contacts of the surfaces of tetrahedral bodies and of a cloth beside them, in slow, plain NumPy float64.

Every vertex against every triangle: the reference of both backends. Like self_contacts.py, which projects them, with
two additions for closed surfaces. The side: a vertex lies inside another body if the vector from its nearest point on
the body's nearest triangle is against that triangle's normal (J. A. Baerentzen, H. Aanaes, IEEE TVCG 11 (2005), without
their weighted normals: against it by more than BEHIND of the vector's length). The consequence: inside a body only its
nearest triangle leads out, and outside of it a triangle that is seen from behind is not a contact. A cloth has neither:
a vertex stays on its side.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.bench.reference.contact.self_contacts import (
    FLAT,
    MARGIN,
    VertexContacts,
    first_with_feature,
    nearest_weights,
    triangles_around,
)
from softlab.bench.reference.contact.self_contacts import project as push
from softlab.model.contact.attachments import attachment_sets
from softlab.model.scene.scene import Scene

BEHIND = 0.25
EXTRA_WEIGHT = (
    0.25  # added to a corner's weight when its particle's mass is split, so that levers act where the weight is 0
)


def force_matrices(corners: np.ndarray, weights: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return matrices A_k (n, 3, 3, 3) of each corner, which gets A_k f of a force f acting at offset `r` (n, 3) [m].

    The offset is from the triangle's point with the `weights` (n, 3). The corner forces add up to f and have its
    moment, unless r is longer than the height of the triangle `corners` (n, 3, 3), which reduces the moment.
    """
    result = weights[:, :, None, None] * np.eye(3)
    for n, (q, way) in enumerate(zip(corners, r, strict=True)):
        normal = np.cross(q[1] - q[0], q[2] - q[0])
        size, far = np.linalg.norm(normal), float(way @ way)
        if size == 0 or far == 0:
            continue
        normal = normal / size
        gradients = np.linalg.pinv(np.column_stack([q[1] - q[0], q[2] - q[0]]))  # of the second and third weight
        across = np.eye(3) - np.outer(way, way) / far
        limit = max(1.0, float(np.sqrt(far) * np.linalg.norm(gradients, axis=1).max()))
        for k, gradient in enumerate(gradients, start=1):
            lever = (gradient @ way * across - (normal @ way) * np.outer(normal, gradient @ across)) / limit
            result[n, k] += lever
            result[n, 0] -= lever
    return result


def project(
    part: Any,
    contacts: VertexContacts,
    before: np.ndarray,
    position: np.ndarray,
    weight: np.ndarray,
    sums: np.ndarray | None = None,
) -> np.ndarray:
    """Return `position` (particles, 3) [m] after the sweeps of the `part`, those that push, then those of friction.

    `weight` (particles,): inverse masses, 0 where pinned; `sums` (n, 4): the normal impulse and the friction of each
    contact in the substep so far, which this adds to.
    """
    sums = np.zeros((len(contacts.mass), 4)) if sums is None else sums
    for _ in range(part.sweeps):
        position = push(part, contacts, before, position, weight, sums[:, 0])
    pressed = sums[:, 0] > 0
    for _ in range(part.sweeps if part.static_friction > 0 else 0):
        rubbed = sums[pressed]
        moved = rub(part, contacts.where(pressed), before, position, weight, rubbed)
        position, sums[pressed] = position + weight[:, None] * moved, rubbed
    return position


def rub(
    part: Any, contacts: VertexContacts, before: np.ndarray, position: np.ndarray, weight: np.ndarray, sums: np.ndarray
) -> np.ndarray:
    """Return particles' displacements (particles, 3) by friction of the `contacts`, for a weight of 1.

    `position`: after the normal impulses of all contacts. `sums` (n, 4): the normal impulse of each contact in the
    substep so far, and its friction, which this adds to. A particle's mass is split among its contacts in proportion to
    their normal impulses. Friction acts against the slip at the vertex, as much as stops it. Coulomb's law limits the
    friction of the substep: beyond, it goes towards the nearest friction that the dynamic coefficient allows, as far as
    that takes energy away.
    """
    press = sums[:, 0]
    parts = press[:, None] * (contacts.weights + EXTRA_WEIGHT)
    load = np.zeros(len(position))
    np.add.at(load, contacts.mass, press)
    np.add.at(load, contacts.corners, parts)
    moved, split = np.zeros_like(position), weight * load
    matrices = force_matrices(
        position[contacts.corners], contacts.weights,
        position[contacts.mass] - np.einsum("nk,nkd->nd", contacts.weights, position[contacts.corners]),
    )  # fmt: skip
    for n, (vertex, corners) in enumerate(zip(contacts.mass, contacts.corners, strict=True)):
        masses, normal = split[corners] / parts[n], contacts.normal[n]
        slip = position[vertex] - before[vertex]
        slip = slip - np.einsum("kdc,kd->c", matrices[n], position[corners] - before[corners])
        slip = slip - (slip @ normal) * normal
        change = -slip * _largest_loss(slip, -slip, matrices[n], split[vertex] / press[n], masses)
        total = sums[n, 1:] + change
        size = float(np.linalg.norm(total))
        if size > part.static_friction * press[n]:
            change = total * (part.dynamic_friction * press[n] / size) - sums[n, 1:]
            change = change * np.clip(_largest_loss(slip, change, matrices[n], split[vertex] / press[n], masses), 0, 1)
        sums[n, 1:] += change
        moved[vertex] += change
        moved[corners] -= matrices[n] @ change
    return moved


def _largest_loss(
    slip: np.ndarray, force: np.ndarray, matrices: np.ndarray, vertex: float, masses: np.ndarray
) -> float:
    """Return the multiple of `force` (3,) at a vertex that takes away the most energy of its `slip` (3,).

    `matrices` (3, 3, 3): of `force_matrices`; inverse masses: `vertex`, and `masses` (3,) of the corners.
    """
    yielding = vertex * (force @ force) + masses @ ((matrices @ force) ** 2).sum(axis=1)
    return float(-(force @ slip) / yielding) if yielding > 0 else 0.0


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


def find(scene: Scene, distance: float, before: np.ndarray, predicted: np.ndarray) -> VertexContacts:
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
    selected = np.full(len(body), distance)
    h = scene.method.dt / scene.method.substeps
    return among(
        every, vertex[apart], triangle[apart], body, closed, selected, part.separation_speed * h, before, predicted
    )


def among(
    every: np.ndarray, vertex: np.ndarray, triangle: np.ndarray, body: np.ndarray, is_closed: np.ndarray,
    distance: np.ndarray, push: float, before: np.ndarray, predicted: np.ndarray,
) -> VertexContacts:  # fmt: skip
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
    around = triangles_around(every, vertex[selected], corners[selected])
    return VertexContacts(
        *[*(a[selected] for a in (vertex, triangle, corners, weights, normal, required, length)), around]
    )
