"""Faults that make a run incomplete although its state is finite, counted in float64 on the host.

They are contacts and neighbours that did not fit into lists of fixed length, inverted tetrahedra, and particles and
vertices trapped in another body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.contact.particle_parameters import G_DISTANCE, kinds_of_particles, pair_rows
from softlab.model.contact.surface_parameters import APART, contact_surface
from softlab.model.core.simulation import Simulation
from softlab.model.geometry.neighbours import TooMany, close_pairs
from softlab.model.scene.scene import Scene

CAUGHT = 0.7  # of the contact distance: nearer pairs are not at rest in a heap
MAX_PARTICLES = 200_000  # above this number the search for trapped particles takes too long, and is omitted
FAULTS = ("contacts_lost", "neighbours_lost", "inverted", "caught")  # each is a count in a report: over 0 is incomplete
INSIDE = 1e-6  # barycentric coordinate: a vertex nearer than that to a side lies on the surface
BATCH = 1 << 12  # tetrahedra per batch


def can_fall_short(scene: Scene) -> bool:
    """Return True if a run of the scene can be incomplete at all: it has contacts, fluids or tetrahedra."""
    collides = scene.contact is not None or scene.self_collision is not None
    return bool(collides or scene.fluids or scene.tetrahedra or scene.is_world)


def inverted_elements(scene: Scene, position: np.ndarray) -> dict[str, int]:
    """Return `inverted`: the number of tetrahedra, alone or in a world, without a positive volume at `position`; {}
    without tetrahedra.
    """
    member, place = _tetrahedra_of(scene)
    if member is None or not np.isfinite(position).all():
        return {}
    return {"inverted": inverted(position[place].astype(np.float64)[member.tetrahedra_set.tetrahedra])}


def _tetrahedra_of(scene: Scene) -> tuple[Scene | None, slice]:
    """Return (the scene of tetrahedral bodies, itself or a member of it, or None; the slice of its particles)."""
    if scene.is_world:
        member = scene.members.get("tetrahedra")
        return member, scene.world_set.slices()["tetrahedra"] if member else slice(None)
    return (scene if scene.tetrahedra else None), slice(None)


def element_faults(scene: Scene, position: np.ndarray, inverse_mass: np.ndarray) -> dict[str, int]:
    """Return `inverted`, see above, and `caught`: the number of vertices in a tetrahedron of another body.

    For a body with self-collision, tetrahedra of the same body count, too. Vertices of a cloth and, in a world,
    particles of bodies are included. {} where there are no tetrahedra.
    """
    member, place = _tetrahedra_of(scene)
    faults = inverted_elements(scene, position)
    if member is None or not faults or scene.contact is None:
        return faults
    members, places = {"tetrahedra": member}, {"tetrahedra": place}
    if scene.is_world:
        members, places = dict(scene.members), scene.world_set.slices()
    elements, everywhere = member.tetrahedra_set, position.astype(np.float64)
    points, body = _meeting(members, places, everywhere, inverse_mass)
    corners = everywhere[place][elements.tetrahedra]
    self_colliding = np.array([part.self_collision for part in member.tetrahedra.values()])
    apart = np.where(self_colliding, APART * contact_surface(elements).edge[: len(self_colliding)], np.inf)
    alike = Elements(elements.tetrahedra, elements.body, elements.position, apart)
    return faults | {"caught": caught_in(points, body, corners, alike)}


def inverted(corners: np.ndarray) -> int:
    """Return the number of tetrahedra with `corners` (n, 4, 3) that have no positive volume."""
    a, b, c = (corners[:, k] - corners[:, 0] for k in (1, 2, 3))
    return int(((a * np.cross(b, c)).sum(axis=1) <= 0).sum())


def _meeting(
    members: dict[str, Scene], places: dict[str, slice], position: np.ndarray, inverse_mass: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the particles that collide with surfaces of tetrahedral bodies: (position (n, 3) [m], tetrahedral body
    (n,) or -1).

    Those of the tetrahedral bodies come first, in their own order, interior ones as NaN.
    """
    member = members["tetrahedra"]
    surface, position_of_member = contact_surface(member.tetrahedra_set), position[places["tetrahedra"]]
    points = np.full(position_of_member.shape, np.nan)
    points[surface.vertices] = position_of_member[surface.vertices]
    body = np.where(surface.body < len(member.tetrahedra_set.parts), surface.body, -1)
    each, bodies = [points], [body]
    for name in members.keys() & {"bodies", "cloth"}:
        there = position[places[name]]
        each.append(there[inverse_mass[places[name]] > 0] if name == "bodies" else there)
        bodies.append(np.full(len(each[-1]), -1))
    return np.concatenate(each), np.concatenate(bodies)


@dataclass(frozen=True)
class Elements:
    """`tetrahedra` (t, 4): particle numbers; `rest` (particles, 3) [m]: their rest positions; `body` (t,): of each;
    `apart` (bodies,) [m]: rest distance from which parts of one body collide, infinite without self-collision."""

    tetrahedra: np.ndarray
    body: np.ndarray
    rest: np.ndarray
    apart: np.ndarray

    def can_collide(self, point: np.ndarray, body: np.ndarray, element: np.ndarray) -> np.ndarray:
        """Return which particles `point` (n,) of tetrahedral bodies `body` (n,) (-1: none) can collide with `element`
        (n,), (n,) bool."""
        other = body != self.body[element]
        some = np.flatnonzero(~other & np.isfinite(self.apart[self.body[element]]))
        offset = self.rest[self.tetrahedra[element[some]]] - self.rest[point[some], None]
        nearest = np.sqrt((offset**2).sum(axis=2).min(axis=1))
        other[some] = nearest > self.apart[self.body[element[some]]]
        return other


def caught_in(points: np.ndarray, body: np.ndarray, corners: np.ndarray, elements: Elements) -> int:
    """Return the number of `points` (n, 3) [m] within a tetrahedron with which they can collide.

    The points of `elements` come first; `corners` (t, 4, 3) [m]: current ones; `body` (n,): tetrahedral body of each
    point, or -1.
    """
    from scipy.spatial import cKDTree

    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(known) or len(points) > MAX_PARTICLES:
        return 0
    middle = corners.mean(axis=1)
    radius = np.sqrt(((corners - middle[:, None]) ** 2).sum(axis=2).max(axis=1))
    tree, hit = cKDTree(points[known]), np.zeros(len(points), bool)
    for begin in range(0, len(corners), BATCH):
        near = tree.query_ball_point(middle[begin : begin + BATCH], radius[begin : begin + BATCH])
        counts = [len(one) for one in near]
        if not sum(counts):
            continue
        point = known[np.concatenate([np.asarray(one, np.int64) for one in near])]
        element = begin + np.repeat(np.arange(len(near)), counts)
        asked = elements.can_collide(point, body[point], element)
        point, element = point[asked], element[asked]
        hit[point[_within(points[point], corners[element])]] = True
    return int(hit.sum())


def _within(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return which of `points` (n, 3) lie inside their tetrahedron `corners` (n, 4, 3), (n,) bool.

    By barycentric coordinates: ratios of volumes (C. Ericson, "Real-Time Collision Detection", 2005, section 3.4).
    """
    a, b, c, p = (corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 0],
                  points - corners[:, 0])  # fmt: skip
    volume = (a * np.cross(b, c)).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (p * np.cross(b, c)).sum(axis=1) / volume
        v = (a * np.cross(p, c)).sum(axis=1) / volume
        w = (a * np.cross(b, p)).sum(axis=1) / volume
        return (u > INSIDE) & (v > INSIDE) & (w > INSIDE) & (u + v + w < 1 - INSIDE)


def caught_particles(scene: Scene, position: np.ndarray, inverse_mass: np.ndarray) -> tuple[int, float | None]:
    """Return (number of trapped particles, smallest distance over the contact distance) among active particles with
    contacts.

    A particle is trapped if it is nearer to one of another body than CAUGHT of the contact distance. The second value
    is None where no pair is near, or there are too many particles to search.
    """
    body_set, there = scene.body_set, np.flatnonzero(inverse_mass > 0)
    if len(there) > MAX_PARTICLES or not np.isfinite(position).all():
        return 0, None
    rows, kind = pair_rows(scene)[:, :, G_DISTANCE], kinds_of_particles(scene)[there]
    try:
        one, other, distance = close_pairs(position[there].astype(np.float64), float(rows.max()))
    except TooMany:
        return 0, None
    least = np.where(body_set.body[there][one] != body_set.body[there][other], rows[kind[one], kind[other]], 0.0)
    touching = least > distance
    part = distance[touching] / least[touching]
    deep = part < CAUGHT
    count = len(np.unique(np.concatenate([one[touching][deep], other[touching][deep]])))
    return count, float(part.min()) if len(part) else None


def shortfalls(simulation: Simulation, position: np.ndarray, inverse_mass: np.ndarray) -> dict[str, float | None]:
    """Return the faults of a run that ended at `position` (particles, dimensions) [m], `inverse_mass` as in State.

    FAULTS, those that the scene can have, 0 if there are none; for particles of bodies also `least_distance`, over the
    contact distance (see `caught_particles`).
    """
    scene = simulation.scene
    faults: dict[str, float | None] = {**simulation.faults(), **element_faults(scene, position, inverse_mass)}
    bodies, place = scene, slice(None)
    if scene.is_world and "bodies" in scene.members:
        bodies, place = scene.members["bodies"], scene.world_set.slices()["bodies"]
    if bodies.bodies and bodies.contact is not None:
        caught, faults["least_distance"] = caught_particles(bodies, position[place], inverse_mass[place])
        faults["caught"] = (faults.get("caught") or 0) + caught
    return faults
