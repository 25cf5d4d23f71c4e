"""Contact surfaces of tetrahedral bodies and of a cloth beside them: vertices, triangles and constants for both
backends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.base.types import Real
from softlab.model.contact.attachments import contact_free
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    H_INVERSE_CELL,
    PAIR_FIELDS,
    PAIRS,
)
from softlab.model.core.parameters import rounded_record
from softlab.model.formulas.contact import FACE, FIRST, FIRST_SECOND, FIRST_THIRD, SECOND, SECOND_THIRD, SHEET, THIRD
from softlab.model.geometry.arithmetic.ordered import norm
from softlab.model.geometry.lists import Lists, grouped, offsets_of
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene

SURFACE_CONTACT_PARAMETERS = (
    "thickness",  # m, distance between surfaces
    "margin",  # m: how much a vertex may come nearer than predicted within a substep, through constraints
    "normal_distance",  # m: nearer than this a triangle's own normal is used
    "push",  # m: how far an overlap is reduced within a substep
    "static_friction",
    "dynamic_friction",
)
EDGE_FRACTION = 0.25  # of the smallest mean edge of the bodies: the default distance
MARGIN = 0.1  # distances
FLAT = 0.0625  # distances: there an ulp of a coordinate is still small relative to the distance in float32
APPROACH = 1.0  # distances: larger approaches in a substep may not be detected before the vertex is inside
STRETCH = 1.2  # of a triangle's edges: up to it the search distance of its corners is large enough
APART = 2.0  # mean edges: parts of a body nearer than that at rest do not collide
FEATURES = {
    (0,): FIRST, (1,): SECOND, (2,): THIRD, (0, 1): FIRST_SECOND, (0, 2): FIRST_THIRD, (1, 2): SECOND_THIRD,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ContactSurface:
    """Surfaces without what attachments move.

    `vertices` (s,) int32: the particles at surfaces, ascending; other tables use indices into them. `triangles` (t, 3)
    int32: particles. `owned` (t,) int32: a bit for each feature that a triangle owns, as the first of those that share
    it, and SHEET for a cloth's. `at_vertex`: triangles at each of the vertices. `body` (particles,) int32. `rest`
    (particles, 3) [m]. `edge`, `corner` (bodies,) [m]: the mean edge of a surface, and the largest distance of a point
    of a triangle from its nearest corner.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    owned: np.ndarray
    at_vertex: Lists
    body: np.ndarray
    rest: np.ndarray
    edge: np.ndarray
    corner: np.ndarray

    @cached_property
    def at_particle(self) -> np.ndarray:
        """Return (particles + 1,) int32: the offsets of `at_vertex`, by particle."""
        lengths = np.zeros(len(self.rest), np.int32)
        lengths[self.vertices] = self.at_vertex.lengths
        return offsets_of(lengths)


_known: WeakKeyDictionary[TetrahedraSet, ContactSurface] = WeakKeyDictionary()


def contact_surface(body_set: TetrahedraSet) -> ContactSurface:
    """Return the surface of all bodies and the cloth, cached with them."""
    if body_set not in _known:
        _known[body_set] = _surface_of_set(body_set)
    return _known[body_set]


def _surface_of_set(body_set: TetrahedraSet) -> ContactSurface:
    first = np.append(body_set.first_particle, body_set.particle_count)
    body = np.repeat(np.arange(len(body_set.names), dtype=np.int32), np.diff(first))
    sheets = np.arange(len(body_set.names)) >= len(body_set.parts)
    return surface_of(body_set.surface, body_set.position, body, sheets, contact_free(body_set))


def surface_of(
    triangles: np.ndarray, position: np.ndarray, body: np.ndarray, sheets: np.ndarray, free: np.ndarray
) -> ContactSurface:
    """Return the surface of `triangles` (t, 3) int32 of particles with the rest positions `position` (particles, 3)
    [m].

    `body`: (particles,) int32; `sheets`: (bodies,) bool, those with two sides and no inside; `free`: (particles,) bool,
    those without contacts.
    """
    count = len(sheets)
    sides = np.stack([norm(position[triangles[:, b]] - position[triangles[:, a]]) for a, b in _SIDES])
    of_body = body[triangles[:, 0]]
    many = np.bincount(of_body, minlength=count)
    edge = np.bincount(of_body, sides.mean(axis=0), count) / np.maximum(many, 1)
    corner = np.zeros(count)
    np.maximum.at(corner, of_body, _farthest(sides))
    triangles = triangles[~free[triangles].any(axis=1)]
    vertices = np.unique(triangles)
    place = np.full(len(position), -1)
    place[vertices] = np.arange(len(vertices))
    corners = triangles.ravel()
    at_vertex = grouped(place[corners], np.arange(len(corners), dtype=np.int32) // 3, len(vertices))
    two_sided = np.where(sheets[body[triangles[:, 0]]], 1 << SHEET, 0)
    owned = (_owners(triangles) | two_sided).astype(np.int32)
    return ContactSurface(vertices.astype(np.int32), triangles, owned, at_vertex, body, position, edge, corner)


_SIDES = ((0, 1), (1, 2), (2, 0))


def _farthest(sides: np.ndarray) -> np.ndarray:
    """Return the largest distance of a point of a triangle with these `sides` (3, t) from its nearest corner, (t,) [m].

    It is the circumradius, or, where an angle is over 90 degrees, half the longest side, which then bounds it.
    """
    a, b, c = np.sort(sides, axis=0)
    area = np.sqrt(np.maximum((a + b + c) * (b + c - a) * (c + a - b) * (a + b - c), 0.0)) / 4
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = a * b * c / (4 * area)
    return np.where(a * a + b * b > c * c, radius, c / 2)


def _owners(triangles: np.ndarray) -> np.ndarray:
    """Return the owned features of each triangle as bits, (t,) int32.

    Testing only owners loses no feature: the owner of the feature on which a nearest point lies is equally near, and is
    found by the same corners.
    """
    owned = np.full(len(triangles), 1 << FACE)
    for length in (1, 2):
        places = [corners for corners in FEATURES if len(corners) == length]
        keys = np.sort(np.concatenate([triangles[:, corners] for corners in places]), axis=1)
        number = np.tile(np.arange(len(triangles)), len(places))
        order = np.lexsort((number, *keys.T))
        fresh = np.ones(len(order), bool)
        fresh[1:] = (keys[order[1:]] != keys[order[:-1]]).any(axis=1)
        features = np.repeat([FEATURES[corners] for corners in places], len(triangles))
        np.bitwise_or.at(owned, number[order[fresh]], 1 << features[order[fresh]])
    return owned.astype(np.int32)


def contact_distance(scene: Scene) -> float:
    """Return the distance between surfaces [m]."""
    assert scene.contact is not None
    return scene.contact.distance or EDGE_FRACTION * float(contact_surface(scene.tetrahedra_set).edge.min())


def surface_record(scene: Scene, distance: float, real: Real) -> np.ndarray:
    """Return SURFACE_CONTACT_PARAMETERS in the arithmetic `real` for surfaces with the contact `distance` [m], (1,).

    Computed in float64, rounded once. Raises SceneError.
    """
    part = scene.contact
    assert part is not None
    h = scene.method.dt / scene.method.substeps
    values = {
        "thickness": distance,
        "margin": MARGIN * distance,
        "normal_distance": FLAT * distance,
        "push": part.separation_speed * h,
        "static_friction": part.static_friction,
        "dynamic_friction": part.dynamic_friction,
    }
    assert tuple(values) == SURFACE_CONTACT_PARAMETERS
    fields = {name: "contact.distance" for name in values} | {"push": "contact.separation_speed"}
    return rounded_record(scene, values, fields, real)


def surface_pairs(scene: Scene) -> np.ndarray:
    """Return rows for the neighbours of surface vertices, (bodies, bodies, PAIR_FIELDS) float64, not symmetric.

    They have the distance within which a vertex of one body searches the corners of another's triangles (see
    model/contact/particle_parameters.py). The vector to the nearest point and that from there to a corner are
    perpendicular.
    """
    surface, distance = contact_surface(scene.tetrahedra_set), contact_distance(scene)
    rows = np.zeros((len(surface.edge), len(surface.edge), PAIR_FIELDS))
    rows[:, :, G_DISTANCE] = distance
    rows[:, :, G_SEARCH_RADIUS] = np.hypot(distance * (1 + MARGIN + APPROACH), STRETCH * surface.corner)
    rows[:, :, G_NEIGHBOURS] = APART * surface.edge
    parts = scene.tetrahedra.values()
    self_colliding = [*(part.self_collision for part in parts), *([False] if scene.mesh else [])]
    rows[:, :, G_SELF_DISTANCE] = np.diag(np.where(self_colliding, distance, 0.0))
    return rows


def neighbour_record(rows: np.ndarray, real: Real) -> np.ndarray:
    """Return the constants of the search for neighbours, (PAIRS + bodies^2 * PAIR_FIELDS,), in the arithmetic `real`.

    `rows`: as from `surface_pairs`.
    """
    head = np.zeros(PAIRS)
    head[H_INVERSE_CELL] = 1 / rows[:, :, G_SEARCH_RADIUS].max()
    return np.concatenate([head, rows.reshape(-1)]).astype(real)


@dataclass(frozen=True)
class Meeting:
    """Surfaces of a scene that collide: `surface`; `distance` [m] between them; `pairs`, as by `surface_pairs`; `ratio`
    (particles,): a vertex's distance from triangles over that distance, where it is not 1 for all."""

    surface: Callable[[Scene], ContactSurface]
    distance: Callable[[Scene], float]
    pairs: Callable[[Scene], np.ndarray]
    ratio: Callable[[Scene], np.ndarray] | None = None

    def record(self, scene: Scene, real: Real) -> np.ndarray:
        """Return the constants, see `surface_record`."""
        return surface_record(scene, self.distance(scene), real)


TETRAHEDRA_MEETING = Meeting(lambda scene: contact_surface(scene.tetrahedra_set), contact_distance, surface_pairs)
