"""Samples of a world's bodies and surfaces for its fluid, carried by their particles."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from softlab.model.base.errors import SceneError
from softlab.model.fluid.samples import (
    CLOSE,
    LEAST,
    Samples,
    joined_samples,
    particle_samples,
    sample_volumes,
    thinned,
    triangle_samples,
)
from softlab.model.geometry.arithmetic.ordered import applied, combined, inverse, norm
from softlab.model.geometry.topology import mesh_of
from softlab.model.particles.world_set import WorldSet
from softlab.model.scene.scene import Scene

COARSEST = 1.25  # rest distances between particles of a body, at most: with more, a fluid flows through between them
THIN = 2.0  # factor of the volumes of a cloth's samples: nothing behind it stops water
BEARING = 1.2  # factor of the volumes of a body's samples; measured: the force on a fixed cube is rho g V within 5 %
NEAREST = 0.9  # of half the sum of both spacings: smallest initial distance between a fluid and a body


@dataclass(frozen=True, eq=False)
class Solids:
    """`particles` (n,) int64, ascending: those of the world that carry samples; `samples`, whose corners are indices
    into them."""

    particles: np.ndarray
    samples: Samples


@dataclass(frozen=True)
class _Sampled:
    """A part of the scene, by its `name`: the world's particles that carry it, its volumes, and the smallest initial
    distance [m] of a fluid's particles from its samples."""

    name: str
    corners: np.ndarray
    weights: np.ndarray
    volume: np.ndarray
    clearance: float


_known: WeakKeyDictionary[WorldSet, Solids] = WeakKeyDictionary()


def solids_of(scene: Scene) -> Solids:
    """Return the solids of a world with a fluid, cached with its particles.

    Raises SceneError where a fluid begins inside a solid, or could flow through one.
    """
    world_set = scene.world_set
    if world_set not in _known:
        fluid = scene.members["fluid"]
        parts = list(_sampled(scene))
        _check_start(scene, parts)
        corners = np.concatenate([part.corners for part in parts])
        particles, places = np.unique(corners, return_inverse=True)
        lightness = fluid.fluid_set.mass / world_set.masses[particles]
        lightness[np.isin(particles, world_set.pinned_vertices)] = 0
        first = 0
        solids: list[tuple[np.ndarray, np.ndarray]] = []
        for part in parts:
            last = first + part.corners.size
            solids.append((places.reshape(-1)[first:last].reshape(-1, 3).astype(np.int32), part.weights))
            first = last
        _known[world_set] = Solids(particles, joined_samples(solids, [part.volume for part in parts], lightness))
    return _known[world_set]


def _sampled(scene: Scene) -> Iterator[_Sampled]:
    """Yield the samples of every body and every surface."""
    slices = scene.world_set.slices()
    if "bodies" in scene.members:
        yield from _bodies(scene, slices["bodies"].start)
    if "tetrahedra" in scene.members:
        body_set, first = scene.members["tetrahedra"].tetrahedra_set, slices["tetrahedra"].start
        ends = [*body_set.first_particle.tolist(), body_set.particle_count]
        names = [*scene.members["tetrahedra"].tetrahedra, *scene.members["tetrahedra"].all_of("mesh")]
        for name, (start, stop) in zip(names, pairwise(ends), strict=False):
            inside = (body_set.surface >= start).all(axis=1) & (body_set.surface < stop).all(axis=1)
            thick = THIN if scene.members["tetrahedra"].kinds[name] == "mesh" else 1.0
            yield _surface(scene, name, body_set.surface[inside].astype(np.int64), body_set.position, first, thick)
    if "cloth" in scene.members:
        cloth_scene, first = scene.members["cloth"], slices["cloth"].start
        assert cloth_scene.mesh is not None
        mesh = mesh_of(cloth_scene.mesh)
        position = scene.world_set.position[slices["cloth"]]
        yield _surface(scene, cloth_scene.name_of("mesh"), mesh.triangles.astype(np.int64), position, first, THIN)


def _bodies(scene: Scene, first: int) -> Iterator[_Sampled]:
    """Yield the samples of bodies of clusters: their particles, thinned where they are dense.

    A copy's volumes are those of the first one.
    """
    member, fluid = scene.members["bodies"], scene.members["fluid"].fluid_set
    selected: dict[str, np.ndarray] = {}
    volumes: dict[str, np.ndarray] = {}
    for copy in member.body_set.copies:
        if copy.name not in volumes:
            apart, most = copy.baked.spacing, COARSEST * fluid.spacing
            if apart > most * (1 + 1e-9):
                reason = (
                    f"must be {most:g} m at most, {COARSEST:g} rest distances; otherwise the fluid leaks through it"
                )
                raise SceneError(f"{copy.name}.particle_spacing", apart, reason)
            selected[copy.name] = thinned(copy.baked.position, LEAST * fluid.spacing)
            points = copy.baked.position[selected[copy.name]]
            volumes[copy.name] = BEARING * sample_volumes(points, fluid.lattice, fluid.support, True)
        particles = selected[copy.name] + copy.particles.start + first
        away = NEAREST * (copy.baked.spacing + fluid.spacing) / 2
        yield _Sampled(copy.name, *particle_samples(particles), volumes[copy.name], away)


def _surface(
    scene: Scene, name: str, triangles: np.ndarray, position: np.ndarray, first: int, thick: float
) -> _Sampled:  # fmt: skip
    """Return the samples of one surface; `position`: of the member's particles; `thick`: factor of volumes."""
    fluid = scene.members["fluid"].fluid_set
    corners, weights = triangle_samples(position, triangles, CLOSE * fluid.spacing)
    points = (weights[:, :, None] * position[corners]).sum(axis=1)
    selected = thinned(points, LEAST * fluid.spacing)
    volume = thick * sample_volumes(points[selected], fluid.lattice, fluid.support, False)
    return _Sampled(name, corners[selected] + first, weights[selected], volume, NEAREST * fluid.spacing / 2)


def _check_start(scene: Scene, parts: list[_Sampled]) -> None:
    """Raise SceneError where a fluid's particles begin inside a solid."""
    fluid, position = scene.members["fluid"].fluid_set, scene.world_set.position
    tree = cKDTree(fluid.position)
    for part in parts:
        points = (part.weights[:, :, None] * position[part.corners]).sum(axis=1)
        _refuse(scene, part.name, tree.query_ball_point(points, part.clearance))
    if "tetrahedra" in scene.members:
        body_set = scene.members["tetrahedra"].tetrahedra_set
        corners = body_set.position[body_set.tetrahedra]
        centre = combined(np.full((1, 4), 0.25), corners)
        near = tree.query_ball_point(centre, norm(corners - centre[:, None]).max(axis=1))
        inside = [
            _within(corner, fluid.position, np.array(some, int)) for corner, some in zip(corners, near, strict=True)
        ]
        _refuse(scene, " or ".join(scene.members["tetrahedra"].tetrahedra), inside)


def _within(corners: np.ndarray, position: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Return the particles among `some` inside the tetrahedron of `corners` (4, 3)."""
    edges = (corners[1:] - corners[0]).T
    weights = applied(inverse(edges), position[some] - corners[0]).T if len(some) else np.zeros((3, 0))
    return some[(weights >= 0).all(axis=0) & (weights.sum(axis=0) <= 1)]


def _refuse(scene: Scene, name: str, touched: Iterable[np.ndarray | list[int]]) -> None:
    """Raise SceneError where any of a fluid's particles is among those `touched` by a solid."""
    fluid = scene.members["fluid"].fluid_set
    inside = np.unique(np.concatenate([np.array(one, int) for one in touched]))
    if len(inside):
        owner = fluid.names[fluid.fluid[inside[0]]]
        reason = f"{len(inside)} of its particles begin inside {name}: move one of them, or leave a gap by `blocks`"
        raise SceneError(f"{owner}.origin", list(scene.members["fluid"].fluids[owner].origin), reason)
