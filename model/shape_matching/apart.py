"""Subsets of a scene's bodies of clusters, for sharing bodies that never collide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softlab.model.assets.clusters import Clusters
from softlab.model.assets.lattice import LatticeCopies
from softlab.model.core.sharing.bodies import Apart, require_apart
from softlab.model.geometry.lists import offsets_of, ranges
from softlab.model.particles.body_set import BodySet, Copy, by_cluster
from softlab.model.particles.links import Links
from softlab.model.scene.scene import Scene


def bodies_apart(scene: Scene) -> Apart:
    """Return the bodies of a scene, balanced by their particles. Raises SceneError where particles may collide."""
    require_apart(scene)
    body_set = scene.body_set
    firsts = np.array([*(one.first_particle for one in body_set.copies), body_set.particle_count])
    return Apart(
        tuple(copy.name for copy in body_set.copies),
        np.diff(firsts), "particles", firsts, "body_set",
        lambda first, end: some_bodies(body_set, first, end),
        lambda first, end: clusters_of(body_set.copies[first:end]),
    )  # fmt: skip


def clusters_of(copies: Sequence[Copy]) -> np.ndarray:
    """Return the indices of the clusters of some copies in the whole set, (n,) int64, ascending."""
    order = by_cluster(copies)
    firsts, counts = (
        np.array(some) for some in zip(*((c.first_cluster, c.baked.clusters.count) for c in order), strict=True)
    )
    return ranges(firsts, counts)[1]


def some_bodies(whole: BodySet, first: int, end: int) -> BodySet:
    """Return copies `first` to before `end`, renumbered from 0, as are their particles and clusters.

    Every value is the whole set's, including its mass unit and spacing, on which kernels depend.
    """
    copies = whole.copies[first:end]
    begin, stop = copies[0].first_particle, copies[-1].particles.stop
    new_cluster, cluster = {}, 0
    for copy in by_cluster(copies):
        new_cluster[copy.number], cluster = cluster, cluster + copy.baked.clusters.count
    chosen = clusters_of(copies)
    return replace(
        whole,
        position=whole.position[begin:stop],
        velocity=whole.velocity[begin:stop],
        body=whole.body[begin:stop] - np.int32(first),
        clusters=_some_clusters(whole.clusters, chosen, begin, stop),
        links=_some_links(whole.links, begin, stop),
        copies=tuple(
            replace(
                copy, number=copy.number - first, first_particle=copy.first_particle - begin,
                first_cluster=new_cluster[copy.number],
            )
            for copy in copies
        ),
        lattices=tuple(_some_lattices(whole, copies, new_cluster)),
        whole=whole,
    )  # fmt: skip


def _some_clusters(whole: Clusters, chosen: np.ndarray, begin: int, stop: int) -> Clusters:
    sizes = np.diff(whole.offsets)[chosen]
    entries = ranges(whole.offsets[chosen].astype(np.int64), sizes)[1]
    return Clusters(
        offsets_of(sizes), (whole.indices[entries] - begin).astype(np.int32), whole.coefficients[entries],
        whole.stiffness[chosen], whole.mass[begin:stop], whole.position[begin:stop],
        whole.material and whole.material.some(chosen),
    )  # fmt: skip


def _some_links(whole: Links, begin: int, stop: int) -> Links:
    """Return the links within the particles, in the colours and the order that they have among all."""
    inside = (whole.ends[:, 0] >= begin) & (whole.ends[:, 0] < stop)
    before = np.concatenate([[0], np.cumsum(inside)])
    return Links(
        (whole.ends[inside] - begin).astype(np.int32), whole.rest_length[inside], whole.compliance[inside],
        before[whole.starts].astype(np.int32),
    )  # fmt: skip


def _some_lattices(whole: BodySet, copies: Sequence[Copy], new_cluster: dict[int, int]) -> list[LatticeCopies]:
    begin, numbers = copies[0].first_particle, {copy.first_particle: copy.number for copy in copies}
    lattices = []
    for one in whole.lattices:
        places = one.first_particle + one.lattice.size * np.arange(one.copies)
        firsts = [int(place) for place in places if int(place) in numbers]
        if firsts:
            cluster = new_cluster[numbers[firsts[0]]]
            lattices.append(replace(one, first_particle=firsts[0] - begin, first_cluster=cluster, copies=len(firsts)))
    return lattices
