"""All bodies of a scene as one set of particles: what a solver of clusters starts from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from model.assets.baked_body import BakedBody
from model.assets.material import joined
from model.core.errors import InputError, SceneError
from model.core.memory import MAX_PARTICLES, available_bytes, require
from model.geometry.arithmetic.ordered import applied, mean, total
from model.geometry.lists import offsets_of
from model.geometry.particle_row import ParticleRow
from model.scene.bodies import Placed
from model.shape_matching.clusters import Clusters
from model.shape_matching.lattice import LatticeCopies
from model.shape_matching.links import LinkedCopies, Links, make_links


@dataclass(frozen=True)
class Copy:
    """A copy of a body: its part's `name`, what it is made of, its first particle and first cluster, its number in all;
    `waits`: whether it is a spare one, which is not there when the scene starts."""

    name: str
    baked: BakedBody = field(repr=False)
    number: int
    first_particle: int
    first_cluster: int
    waits: bool = False

    @property
    def particles(self) -> slice:
        """Where in the set its particles are."""
        return slice(self.first_particle, self.first_particle + len(self.baked.position))


@dataclass(frozen=True, eq=False)
class BodySet(ParticleRow):
    """The particles of all copies, one after the other, in the order of the file.

    `position` (particles, 3) float64 [m], at the start; `velocity` likewise [m/s]; `body` (particles,) int32: the copy each
    is of; `clusters`, whose rest positions are those at the start, with those of `lattices` last; `links`; `copies`. To the
    rest of the lab it is a row of masses: `rows` 1, `columns` all, `spacing` [m], the mean one, and `mass` [kg], see
    `unit_of`. `whole`: the set of which this is a share (model/shape_matching/apart.py), None: it is none.
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
        """The clusters that are no windows of a lattice, the first ones of all."""
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
        """The copies, in the order of their clusters."""
        return _by_cluster(self.copies)

    @property
    def alike(self) -> BodySet:
        """The set that says what code its loose clusters need: the whole one, so that every share runs the same."""
        return self.whole if self.whole and self.loose.count else self

    @property
    def waiting(self) -> np.ndarray:
        """(particles,) bool: those of spare copies, which wait at the place of their body's first one."""
        return np.array([copy.waits for copy in self.copies])[self.body]

    @property
    def extent(self) -> float:
        """Its longest side [m]."""
        return float(np.ptp(self.position, axis=0).max(initial=self.spacing))


def make_body_set(parts: Mapping[str, Placed]) -> BodySet:
    """The body set of a scene's bodies, by name. Raises SceneError where it has too many particles."""
    for name, part in parts.items():
        try:
            part.baked  # noqa: B018 - made here, so that its errors name the part
        except SceneError as error:
            raise SceneError(f"{name}.{error.field}", error.value, error.allowed) from None
        except InputError as error:
            raise InputError(f"{name}: {error}") from None
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
        made, turn, cluster = part.baked, part.turn(), first_clusters[name]
        here = applied(turn, made.position)
        centre = total(made.mass[:, None] * here) / total(made.mass)
        moving = np.asarray(part.velocity) + np.cross(np.asarray(part.spin), here - centre)
        places = part.places()
        if made.lattice and is_summed(made):
            stiffness = float(made.clusters.stiffness[0])
            lattices.append(LatticeCopies(made.lattice, particle, cluster, part.count + part.spare, stiffness, turn))
        for number, place in enumerate([*places, *places[:1].repeat(part.spare, axis=0)]):
            waits = number >= part.count
            copies.append(Copy(name, made, len(copies), particle, cluster, waits))
            positions.append(here + place)
            velocities.append(0 * moving if waits else moving)
            particle, cluster = particle + len(here), cluster + made.clusters.count
    position, mass = np.concatenate(positions), np.concatenate([copy.baked.mass for copy in copies])
    in_order = _by_cluster(copies)
    made_of = [copy.baked.clusters for copy in in_order]
    clusters = Clusters(
        offsets_of(np.concatenate([np.diff(one.offsets) for one in made_of])),
        np.concatenate([copy.baked.clusters.indices + copy.first_particle for copy in in_order]).astype(np.int32),
        np.concatenate([one.coefficients for one in made_of]),
        np.concatenate([one.stiffness for one in made_of]),
        mass,
        position,
        joined([one.material for one in made_of], [one.count for one in made_of]),
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
    """Unit of the solvers' masses [kg]: the power of two next to the mean of `masses` (particles,) [kg], so that dividing by
    it rounds nothing, and bodies that are added leave the others' bits as they are."""
    return float(2.0 ** round(math.log2(mean(masses))))


def _bytes_of(body: BakedBody) -> int:
    """Of a copy's particles, clusters and links while they are put together."""
    return 160 * len(body.position) + 40 * len(body.clusters.indices) + 60 * len(body.links)


def _by_cluster(copies: Sequence[Copy]) -> list[Copy]:
    return sorted(copies, key=lambda copy: copy.first_cluster)


def is_summed(body: BakedBody) -> bool:
    """Whether a body's clusters are windows that do nothing beside turning, which passes along the axes sum up."""
    return body.lattice is not None and not body.clusters.parts


def _first_clusters(parts: Mapping[str, Placed]) -> dict[str, int]:
    """The first cluster of each part: those of lattices come last."""
    found, cluster = {}, 0
    for summed in (False, True):
        for name, part in parts.items():
            if is_summed(part.baked) == summed:
                found[name] = cluster
                cluster += (part.count + part.spare) * part.baked.clusters.count
    return found


def _linked(copies: list[Copy]) -> list[LinkedCopies]:
    """The links of each part, its copies side by side."""
    found = []
    for _, group in groupby(copies, key=lambda copy: copy.name):
        same = list(group)
        made, firsts = same[0].baked, np.array([copy.first_particle for copy in same])
        found.append(LinkedCopies(made.links, made.rest_length, made.link_stiffness, firsts, len(made.position)))
    return found
