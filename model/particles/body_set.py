"""All bodies of a scene as one set of particles: the initial state of a solver of clusters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from softlab.model.assets.baked_body import BakedBody
from softlab.model.assets.clusters import Clusters
from softlab.model.assets.lattice import LatticeCopies
from softlab.model.assets.material import joined
from softlab.model.base.errors import SceneError, naming
from softlab.model.base.memory import MAX_PARTICLES, available_bytes, require
from softlab.model.geometry.arithmetic.ordered import applied, mean, total
from softlab.model.geometry.lists import offsets_of
from softlab.model.geometry.particle_row import ParticleRow
from softlab.model.particles.links import LinkedCopies, Links, make_links
from softlab.model.tables.bodies import Placed


@dataclass(frozen=True)
class Copy:
    """A copy of a body: its part's `name`, its baked body, its first particle and first cluster, its number among all
    copies.

    `waits`: True for a spare copy, which is inactive at the start.
    """

    name: str
    baked: BakedBody = field(repr=False)
    number: int
    first_particle: int
    first_cluster: int
    waits: bool = False

    @property
    def particles(self) -> slice:
        """Slice of its particles in the set."""
        return slice(self.first_particle, self.first_particle + len(self.baked.position))


@dataclass(frozen=True, eq=False)
class BodySet(ParticleRow):
    """The particles of all copies, concatenated in the order of the file.

    `position` (particles, 3) float64 [m] and `velocity` [m/s]: initial ones; `body` (particles,) int32: the copy of
    each; `clusters`: with the initial positions as rest positions, those of `lattices` last; `links`; `copies`. It has
    the attributes of a row of masses: `rows` 1, `columns` the number of particles, `spacing` [m], the mean one, and
    `mass` [kg], see `unit_of`. `whole`: the set of which this is a block (model/shape_matching/apart.py), or None.
    """

    position: np.ndarray
    velocity: np.ndarray
    body: np.ndarray
    clusters: Clusters
    links: Links
    copies: tuple[Copy, ...]
    spacing: float
    mass: float
    lattices: tuple[LatticeCopies, ...] = ()
    pinned: str = "none"
    whole: BodySet | None = None

    @cached_property
    def loose(self) -> Clusters:
        """The clusters that are not windows of a lattice; they come first."""
        if not self.lattices:
            return self.clusters
        whole, count = self.clusters, min(lattice.first_cluster for lattice in self.lattices)
        last = whole.offsets[count]
        return replace(
            whole, offsets=whole.offsets[: count + 1], indices=whole.indices[:last], coefficients=whole.coefficients[:last],
            stiffness=whole.stiffness[:count], material=whole.material and whole.material.first(count),
        )  # fmt: skip

    @property
    def in_cluster_order(self) -> list[Copy]:
        """Copies, in the order of their clusters."""
        return by_cluster(self.copies)

    @property
    def alike(self) -> BodySet:
        """The set that decides which code its loose clusters need: that of the whole scene, so that every block runs
        the same code."""
        return self.whole if self.whole and self.loose.count else self

    @property
    def waiting(self) -> np.ndarray:
        """Particles of spare copies, (particles,) bool, at the position of their body's first copy."""
        return np.array([copy.waits for copy in self.copies])[self.body]

    @property
    def masses(self) -> np.ndarray:
        """Mass of each particle, (particles,) float64 [kg]."""
        return self.clusters.mass

    @property
    def lightest(self) -> float:
        """Smallest mass of a particle [kg]."""
        return float(self.masses.min())

    @property
    def pinned_vertices(self) -> np.ndarray:
        """Particles that do not move at the start, ascending: inactive ones."""
        return np.flatnonzero(self.waiting)

    @property
    def extent(self) -> float:
        """Longest side [m]."""
        return float(np.ptp(self.position, axis=0).max(initial=self.spacing))


def make_body_set(parts: Mapping[str, Placed]) -> BodySet:
    """Return the body set of a scene's bodies, by name. Raises SceneError where it has too many particles."""
    for name, part in parts.items():
        with naming(name, files=True):
            part.baked  # noqa: B018 - made here, so that its errors name the part
    particles = sum(len(part.baked.position) * (part.count + part.spare) for part in parts.values())
    if particles > MAX_PARTICLES:
        raise SceneError("copies", particles, f"at most {MAX_PARTICLES} particles (32-bit indices)")
    needed = sum((part.count + part.spare) * _bytes_of(part.baked) for part in parts.values())
    require(needed, available_bytes(), "copies", particles, "main memory")
    copies: list[Copy] = []
    positions, velocities = [], []
    lattices, particle = [], 0
    first_clusters = _first_clusters(parts)
    for name, part in parts.items():
        baked, turn, cluster = part.baked, part.turn(), first_clusters[name]
        here = applied(turn, baked.position)
        centre = total(baked.mass[:, None] * here) / total(baked.mass)
        moving = np.asarray(part.velocity) + np.cross(np.asarray(part.spin), here - centre)
        places = part.places()
        if baked.lattice and is_summed(baked):
            stiffness = float(baked.clusters.stiffness[0])
            lattices.append(LatticeCopies(baked.lattice, particle, cluster, part.count + part.spare, stiffness, turn))
        for number, place in enumerate([*places, *places[:1].repeat(part.spare, axis=0)]):
            waits = number >= part.count
            copies.append(Copy(name, baked, len(copies), particle, cluster, waits))
            positions.append(here + place)
            velocities.append(0 * moving if waits else moving)
            particle, cluster = particle + len(here), cluster + baked.clusters.count
    position, mass = np.concatenate(positions), np.concatenate([copy.baked.mass for copy in copies])
    in_order = by_cluster(copies)
    cluster_sets = [copy.baked.clusters for copy in in_order]
    clusters = Clusters(
        offsets_of(np.concatenate([np.diff(one.offsets) for one in cluster_sets])),
        np.concatenate([copy.baked.clusters.indices + copy.first_particle for copy in in_order]).astype(np.int32),
        np.concatenate([one.coefficients for one in cluster_sets]),
        np.concatenate([one.stiffness for one in cluster_sets]),
        mass,
        position,
        joined([one.material for one in cluster_sets], [one.count for one in cluster_sets]),
    )
    spacing = mean(np.array([copy.baked.spacing for copy in copies]))
    return BodySet(
        position,
        np.concatenate(velocities),
        np.repeat(np.arange(len(copies), dtype=np.int32), [len(one) for one in positions]),
        clusters,
        make_links(_linked(copies)),
        tuple(copies),
        spacing,
        unit_of(mass),
        tuple(lattices),
    )


def unit_of(masses: np.ndarray) -> float:
    """Return the unit of the solvers' masses [kg]: the power of two nearest to the mean of `masses` (particles,) [kg].

    Division by it is exact, and added bodies leave the others' bits unchanged.
    """
    return float(2.0 ** round(math.log2(mean(masses))))


def _bytes_of(body: BakedBody) -> int:
    """Return the bytes of a copy's particles, clusters and links during assembly."""
    return 160 * len(body.position) + 40 * len(body.clusters.indices) + 60 * len(body.links)


def by_cluster(copies: Sequence[Copy]) -> list[Copy]:
    """Return the copies in the order of their clusters."""
    return sorted(copies, key=lambda copy: copy.first_cluster)


def is_summed(body: BakedBody) -> bool:
    """Return True if a body's clusters are windows that only rotate, which passes along the axes can sum."""
    return body.lattice is not None and not body.clusters.parts


def _first_clusters(parts: Mapping[str, Placed]) -> dict[str, int]:
    """Return the first cluster of each part: those of lattices come last."""
    first, cluster = {}, 0
    for summed in (False, True):
        for name, part in parts.items():
            if is_summed(part.baked) == summed:
                first[name] = cluster
                cluster += (part.count + part.spare) * part.baked.clusters.count
    return first


def _linked(copies: list[Copy]) -> list[LinkedCopies]:
    """Return the links of each part with its copies."""
    linked = []
    for _, group in groupby(copies, key=lambda copy: copy.name):
        same = list(group)
        baked, firsts = same[0].baked, np.array([copy.first_particle for copy in same])
        linked.append(LinkedCopies(baked.links, baked.rest_length, baked.link_stiffness, firsts, len(baked.position)))
    return linked
