"""Contacts of a cloth with itself in slow, plain NumPy float64, every mass against every triangle: the reference.

From the papers, without model/formulas or a backend. The nearest point of a triangle is the projection into its plane
where that lies inside, else the nearest point of its three sides. A contact requires n . (p - sum of b_k q_k) >= d with
n and the b_k of the beginning of the substep (C. Lewin, "Cloth Self Collision with Predictive Contacts", GDC 2018), as
far as the mass is nearer than d to where the triangles are now. One sweep projects all contacts that are too near at
once, each divided by the bound of its row in the contacts' system (Gershgorin; R. Tonge et al., "Mass Splitting for
Jitter-Free Parallel Rigid Body Simulation", SIGGRAPH 2012). Friction as in M. Macklin et al., "Unified Particle Physics
for Real-Time Applications", SIGGRAPH 2014, eq. 24.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.bench.reference import cloth, xpbd
from softlab.bench.reference.steps import pinned_mask
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene
from softlab.model.tables.self_collision import SelfCollision

# of the thickness: margin of the contact search beyond the predicted motion; distance below which the triangle's normal
# replaces the vector from the nearest point; height over the plane below which a mass is on neither side
MARGIN, FLAT, COINCIDENT = 0.1, 0.0625, 1e-3
PARALLEL = 0.99999  # cosine of a contact's normal with the triangle's, above which it is the triangle's
PAST = 2.0**-10  # of a triangle: margin beyond its edges within which a path through its plane is one through it


@dataclass(frozen=True)
class VertexContacts:
    """Contacts, (n,) each, by mass, then by distance, then by triangle; `corners` and `weights` (n, 3), `normal` (n,
    3).
    """

    mass: np.ndarray
    triangle: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    normal: np.ndarray
    required: np.ndarray  # m, the required distance
    distance: np.ndarray  # m, at the beginning of the substep
    around: np.ndarray  # object, (m, 3) int each: corners of the triangles with one of the triangle's corners

    def nearest(self, most: int) -> VertexContacts:
        """Return the `most` nearest contacts of every mass."""
        rank = np.arange(len(self.mass)) - np.searchsorted(self.mass, self.mass)
        return self.where(rank < most)

    def where(self, chosen: np.ndarray) -> VertexContacts:
        """Return the contacts whose entry in `chosen` (n,) is true."""
        return VertexContacts(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


def triangles(rows: int, columns: int) -> np.ndarray:
    """Return (2 (rows - 1) (columns - 1), 3) masses: of a cell A B over C D first (A, C, D), then (A, D, B)."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    return np.stack([np.stack([a, c, d], -1), np.stack([a, d, b], -1)], axis=2).reshape(-1, 3)


def nearest_weights(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return barycentric weights (n, 3) of the point of triangles (n, 3, 3) nearest to (n, 3) points; exactly 0 off a
    feature.
    """
    u, v, r = q[:, 1] - q[:, 0], q[:, 2] - q[:, 0], p - q[:, 0]
    gram = np.stack([np.einsum("nk,nk->n", x, y) for x, y in ((u, u), (u, v), (v, v), (r, u), (r, v))])
    uu, uv, vv, ru, rv = gram
    determinant = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        b, c = (vv * ru - uv * rv) / determinant, (uu * rv - uv * ru) / determinant
    inside = (b > 0) & (c > 0) & (b + c < 1)  # false for a triangle without an area
    best = np.where(inside[:, None], np.stack([1 - b - c, b, c], -1), 0.0)
    least = np.where(inside, 0.0, np.inf)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        side = q[:, second] - q[:, first]
        size = np.einsum("nk,nk->n", side, side)
        part = np.einsum("nk,nk->n", p - q[:, first], side) / np.where(size > 0, size, 1)
        part = np.clip(part, 0.0, 1.0)
        distance = np.linalg.norm(p - q[:, first] - part[:, None] * side, axis=1)
        weights = np.zeros_like(best)
        weights[:, first], weights[:, second] = 1 - part, part
        nearer = ~inside & (distance < least)
        best[nearer], least = weights[nearer], np.where(nearer, distance, least)
    return best


def first_with_feature(every: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of triangles that are the first of all with their corners of non-zero weight."""
    holders: dict[int, set[int]] = {}
    for number, triangle in enumerate(every.tolist()):
        for vertex in triangle:
            holders.setdefault(vertex, set()).add(number)
    result = np.zeros(len(corners), bool)
    for n, (triangle, weight) in enumerate(zip(corners.tolist(), weights, strict=True)):
        feature = [vertex for vertex, w in zip(triangle, weight, strict=True) if w > 0]
        result[n] = every[min(set.intersection(*(holders[vertex] for vertex in feature)))].tolist() == triangle
    return result


def find(
    part: SelfCollision, rows: int, columns: int, spacing: float, before: np.ndarray, predicted: np.ndarray, h: float
) -> VertexContacts:
    """Return the contacts that are possible in a substep of `h` [s] from `before` to `predicted` (particles, 3) [m].

    A contact is a mass and a triangle without it as a corner, whose nearest point is nearer than the thickness, a
    margin, and the largest motion of the mass relative to one of the corners. Of triangles that share the feature with
    that point only the first counts.
    """
    every = triangles(rows, columns)
    mass, triangle = (a.ravel() for a in np.meshgrid(np.arange(rows * columns), np.arange(len(every)), indexing="ij"))
    apart = (every[triangle] != mass[:, None]).all(axis=1)
    mass, triangle = mass[apart], triangle[apart]
    corners = every[triangle]
    weights = nearest_weights(before[mass], before[corners])
    r = before[mass] - np.einsum("nk,nkd->nd", weights, before[corners])
    distance = np.linalg.norm(r, axis=1)
    move = predicted - before
    motion = np.linalg.norm(move[mass][:, None] - move[corners], axis=2).max(axis=1)
    near = distance < part.thickness * (1 + MARGIN) + motion
    near[near] = first_with_feature(triangles(rows, columns), corners[near], weights[near])
    mass, triangle, corners, weights = mass[near], triangle[near], corners[near], weights[near]
    r, distance = r[near], distance[near]
    normal = _normals(part.thickness, before, mass, corners, r, distance)
    place = np.stack(np.divmod(np.arange(rows * columns), columns), -1) * spacing
    rest = np.linalg.norm(place[mass] - np.einsum("nk,nkd->nd", weights, place[corners]), axis=1)
    gap = np.einsum("nk,nk->n", normal, r)
    required = np.minimum(np.minimum(part.thickness, rest), gap + part.separation_speed * h)
    order = np.lexsort((triangle, distance, mass))
    mass, triangle, corners = mass[order], triangle[order], corners[order]
    around = triangles_around(every, mass, corners)
    weights, normal, required, distance = (a[order] for a in (weights, normal, required, distance))
    return VertexContacts(mass, triangle, corners, weights, normal, required, distance, around)


def triangles_around(every: np.ndarray, mass: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return (n,) object: of `every` triangle those without the mass that have one of the `corners` (n, 3)."""
    holds: dict[int, list[int]] = {}
    for number, own in enumerate(every.tolist()):
        for corner in own:
            holds.setdefault(corner, []).append(number)
    result = np.empty(len(mass), object)
    for n, own in enumerate(corners.tolist()):
        near = every[sorted({number for corner in own for number in holds[corner]})]
        result[n] = near[(near != mass[n]).all(axis=1)]
    return result


def _normals(
    thickness: float, before: np.ndarray, mass: np.ndarray, corners: np.ndarray, r: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Return normals (n, 3) from the nearest point to the mass.

    If that vector is too short, it is the triangle's normal on the mass's side; if the mass is on neither side, the
    normal for a mass whose number is above that of the triangle's first corner, its opposite for the others.
    """
    q = before[corners]
    normal = np.cross(q[:, 1] - q[:, 0], q[:, 2] - q[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0)
    side = np.einsum("nk,nk->n", normal, r)
    up = [(y > 0) or (y == 0 and (x > 0 or (x == 0 and z > 0))) for x, y, z in normal]
    outside = np.where(np.abs(side) <= COINCIDENT * thickness, np.array(up, bool) == (mass > corners[:, 0]), side > 0)
    normal = np.where(outside[:, None], normal, -normal)
    far = distance > FLAT * thickness
    normal[far] = r[far] / distance[far, None]
    return normal


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


def limited(
    contacts: VertexContacts, r: np.ndarray, before: np.ndarray, now: np.ndarray, deep: np.ndarray
) -> np.ndarray:
    """Return the remaining part of the planes' depth `deep` with the triangles at `now`: (n,) [m].

    It is at most the missing distance of the vertex from its triangle, unless the vertex began inside (`r`, at the
    beginning of the substep, against the normal), or came through one of the triangles around. Beside a triangle whose
    own normal is the contact's, the distance is that from the nearest one around.
    """
    old, new = before[contacts.corners], now[contacts.corners]
    normal = np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0])
    own = np.abs((contacts.normal * normal).sum(axis=1)) >= PARALLEL * np.linalg.norm(normal, axis=1)
    beside = own & (_heights(now[contacts.mass], new)[:, :3] < 0).any(axis=1)
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


def project(
    part: SelfCollision,
    contacts: VertexContacts,
    before: np.ndarray,
    position: np.ndarray,
    weight: np.ndarray,
    press: np.ndarray | None = None,
) -> np.ndarray:
    """Return `position` after one sweep: (particles, 3) [m].

    `weight` (particles,): inverse masses, 0 where pinned; `press` (n,): normal impulses are added to it, for surfaces,
    whose friction comes later.
    """

    def offset(p: np.ndarray) -> np.ndarray:
        return p[contacts.mass] - np.einsum("nk,nkd->nd", contacts.weights, p[contacts.corners])

    now = offset(position)
    depth = contacts.required - np.einsum("nk,nk->n", contacts.normal, now)
    depth = limited(contacts, offset(before), before, position, depth)
    on = depth > 0
    load = np.zeros(len(position))
    np.add.at(load, contacts.mass[on], 1.0)
    np.add.at(load, contacts.corners[on], contacts.weights[on])
    bound = weight[contacts.mass] * load[contacts.mass]
    bound = bound + (contacts.weights * (weight * load)[contacts.corners]).sum(axis=1)
    on &= bound > 0
    slid = now - offset(before)
    slid -= np.einsum("nk,nk->n", contacts.normal, slid)[:, None] * contacts.normal
    size = np.linalg.norm(slid, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        stopped = np.where(size <= part.static_friction * depth, 1.0, part.dynamic_friction * depth / size)
        stopped *= press is None
        push = (depth[:, None] * contacts.normal - stopped[:, None] * slid) / bound[:, None]
    moved = np.zeros_like(position)
    np.add.at(moved, contacts.mass[on], push[on])
    np.subtract.at(moved, contacts.corners[on], contacts.weights[on][:, :, None] * push[on][:, None])
    if press is not None:
        press[on] += depth[on] / bound[on]
    return position + weight[:, None] * moved


def simulate(
    scene: Scene, steps: int, position: np.ndarray, velocity: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (position, velocity) (particles, 3) float64 after `steps` steps of a cloth under xpbd.

    With gravity and colliders; contacts with itself are projected in every iteration after the springs. Raises
    SceneError for parts that are not supported here.
    """
    if scene.wind or scene.external or scene.attachments or scene.loads or not scene.self_collision:
        raise SceneError(
            "scene", scene.name, "the reference of contacts supports springs, gravity, dampers and colliders"
        )
    grid, method, part = scene.grid, scene.method, scene.self_collision
    h, shape = method.dt / method.substeps, (grid.rows, grid.columns, 3)
    constraints = xpbd.of_scene(scene)
    inverse_mass = np.where(pinned_mask(scene).ravel(), 0.0, 1 / grid.mass)
    free, fine = (inverse_mass > 0)[:, None], scene.replace({"method.dt": h})
    drag = (scene.damping.coefficient if scene.damping else 0.0) / grid.mass
    gravity = np.array([0.0, -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0, 0.0])
    ordering = {"jacobi": "weighted-jacobi"}.get(method.ordering, method.ordering)
    p, v = position, velocity
    for number in range(steps * method.substeps):
        before = p
        v = np.where(free, v * (1 - h * drag) + h * gravity, 0.0)
        p, multipliers = before + h * v, np.zeros(len(constraints.first))
        contacts = find(part, grid.rows, grid.columns, grid.spacing, before, p, h).nearest(most)
        for _ in range(method.iterations):
            p, multipliers = xpbd.iterate(constraints, p, multipliers, before, inverse_mass, h, ordering)
            for _ in range(part.sweeps):
                p = project(part, contacts, before, p, inverse_mass * grid.mass)
        v = (p - before) / h
        if scene.colliders:
            moved = cloth.collide(fine, before.reshape(shape), p.reshape(shape), v.reshape(shape), number)
            p, v = moved[0].reshape(-1, 3), moved[1].reshape(-1, 3)
        p, v = np.where(free, p, before), np.where(free, v, 0.0)
    return p, v
