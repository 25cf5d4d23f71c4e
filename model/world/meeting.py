"""Contact geometry between a world's members: triangles of tetrahedral bodies and cloths, and balls.

A particle of bodies is a ball that keeps its radius from triangles. Contacts within a member are handled by the member.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from softlab.model.contact.particle_parameters import G_DISTANCE, G_SEARCH_RADIUS, PAIR_FIELDS, kinds_of_particles
from softlab.model.contact.surface_parameters import (
    APPROACH,
    EDGE_FRACTION,
    MARGIN,
    STRETCH,
    ContactSurface,
    Meeting,
    contact_surface,
    surface_of,
)
from softlab.model.core.build import rest_positions
from softlab.model.geometry.lists import Lists
from softlab.model.particles.world_set import WorldSet
from softlab.model.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class CrossSurface:
    """Particles with contacts between members.

    `particles` (n,) int64, ascending: of the world; `surface`: their triangles, numbered by index into `particles`, its
    bodies being groups; `member` (groups,) int: each group's member; `radius` (groups,) [m] of balls, NaN for surfaces.
    """

    particles: np.ndarray
    surface: ContactSurface
    member: np.ndarray
    radius: np.ndarray


_known: WeakKeyDictionary[WorldSet, CrossSurface] = WeakKeyDictionary()


def cross_surface(scene: Scene) -> CrossSurface:
    """Return the surface of a world, cached with its particles."""
    world_set = scene.world_set
    if world_set not in _known:
        first = dict(zip(world_set.names, world_set.first.tolist(), strict=False))
        _known[world_set] = _joined(
            [
                _moved(one, first[name], number)
                for number, (name, member) in enumerate(scene.members.items())
                if (one := _of_member(name, member)) is not None
            ]
        )
    return _known[world_set]


def _of_member(name: str, scene: Scene) -> CrossSurface | None:
    """Return the surface of a single member; None if it has no contacts."""
    if name == "bodies":
        return _balls(scene)
    if name == "tetrahedra":
        surface = contact_surface(scene.tetrahedra_set)
    elif name == "cloth":
        count = scene.grid.particle_count
        position, none = rest_positions(scene.grid), np.zeros(count, bool)
        body = np.zeros(count, np.int32)
        surface = surface_of(scene.grid.triangles().astype(np.int32), position, body, np.ones(1, bool), none)
    else:
        return None
    return _compact(surface)


def _balls(scene: Scene) -> CrossSurface:
    """Return every particle of bodies; a group is a part of the scene, with all its copies."""
    count, parts = scene.body_set.particle_count, scene.bodies.values()
    radius = np.array([part.contact_radius for part in parts])
    none, position = np.zeros(len(radius)), scene.body_set.position
    every = np.arange(count, dtype=np.int32)
    lists = Lists(np.zeros(count + 1, np.int32), np.zeros(0, np.int32))
    surface = ContactSurface(
        every, np.zeros((0, 3), np.int32), np.zeros(0, np.int32), lists, kinds_of_particles(scene), position, none, none
    )
    return CrossSurface(every.astype(np.int64), surface, np.zeros(len(radius), np.int64), radius)


def _compact(surface: ContactSurface) -> CrossSurface:
    """Return a surface with only the particles that are its vertices."""
    vertices = surface.vertices
    place = np.full(len(surface.rest), -1, np.int32)
    place[vertices] = np.arange(len(vertices))
    groups = len(surface.edge)
    compact = ContactSurface(
        np.arange(len(vertices), dtype=np.int32), place[surface.triangles], surface.owned, surface.at_vertex,
        surface.body[vertices], surface.rest[vertices], surface.edge, surface.corner,
    )  # fmt: skip
    return CrossSurface(vertices.astype(np.int64), compact, np.zeros(groups, np.int64), np.full(groups, np.nan))


def _moved(one: CrossSurface, first: int, member: int) -> CrossSurface:
    return CrossSurface(one.particles + first, one.surface, np.full_like(one.member, member), one.radius)


def _joined(members: list[CrossSurface]) -> CrossSurface:
    """Return concatenated surfaces, numbered consecutively."""
    surfaces = [one.surface for one in members]
    vertex, triangle, group = (
        np.append(0, np.cumsum([len(array(one)) for one in surfaces]))
        for array in (lambda s: s.vertices, lambda s: s.triangles, lambda s: s.edge)
    )

    def joined(*arrays: np.ndarray) -> np.ndarray:
        return np.concatenate(arrays)

    def shifted(name: str, by: np.ndarray) -> np.ndarray:
        return joined(*(getattr(one, name) + np.int32(start) for one, start in zip(surfaces, by, strict=False)))

    def whole(name: str) -> np.ndarray:
        return joined(*(getattr(one, name) for one in surfaces))

    ends = [one.at_vertex.offsets for one in surfaces]
    entries = np.append(0, np.cumsum([offsets[-1] for offsets in ends]))
    offsets = joined(*(stops[:-1] + start for stops, start in zip(ends, entries, strict=False)), entries[-1:])
    at_vertex = joined(
        *(one.at_vertex.indices + np.int32(start) for one, start in zip(surfaces, triangle, strict=False))
    )
    surface = ContactSurface(
        shifted("vertices", vertex), shifted("triangles", vertex), whole("owned"),
        Lists(offsets.astype(np.int32), at_vertex.astype(np.int32)), shifted("body", group), whole("rest"), whole("edge"),
        whole("corner"),
    )  # fmt: skip
    particles, member = joined(*(one.particles for one in members)), joined(*(one.member for one in members))
    radius = joined(*(one.radius for one in members))
    return CrossSurface(particles, surface, member, radius)


def cross_distance(scene: Scene) -> float:
    """Return the distance between surfaces [m]; half of it is a triangle's own."""
    assert scene.contact is not None
    edge = cross_surface(scene).surface.edge
    return scene.contact.distance or EDGE_FRACTION * float(edge[edge > 0].min())


def distances_of_groups(scene: Scene) -> np.ndarray:
    """Return the distance of each group's vertices from triangles, (groups,) [m].

    A ball's is its radius plus half the distance between surfaces.
    """
    distance, radius = cross_distance(scene), cross_surface(scene).radius
    return np.where(np.isnan(radius), distance, radius + distance / 2)


def _pairs(scene: Scene) -> np.ndarray:
    """Return rows as by `surface_pairs` of model/contact/surface_parameters.py, for groups of different members."""
    surface, distance = cross_surface(scene), distances_of_groups(scene)
    collide = (surface.member[:, None] != surface.member) & (surface.surface.edge > 0)
    rows = np.zeros((*collide.shape, PAIR_FIELDS))
    rows[:, :, G_DISTANCE] = distance[:, None] * collide
    rows[:, :, G_SEARCH_RADIUS] = (
        np.hypot(distance[:, None] * (1 + MARGIN + APPROACH), STRETCH * surface.surface.corner) * collide
    )
    return rows


def _ratio(scene: Scene) -> np.ndarray:
    """Return `ratio` of Meeting, (n,)."""
    return (distances_of_groups(scene) / cross_distance(scene))[cross_surface(scene).surface.body]


MEMBERS_MEETING = Meeting(lambda scene: cross_surface(scene).surface, cross_distance, _pairs, _ratio)
