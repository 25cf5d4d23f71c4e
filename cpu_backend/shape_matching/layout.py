"""Memory layout of the particles, entries and clusters of a body set, in whole blocks of LANES
(shape_matching/kernels.py)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softlab.cpu_backend.shape_matching.arrays import ClusterArrays
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.particles.body_set import BodySet
from softlab.model.shape_matching.cluster_tables import first_particles, leans

LONE, SCATTERED = 2, 1  # kinds of rigid clusters: a whole body, with its particles in order; others

Bounds = tuple[np.ndarray, np.ndarray]  # first particles and first clusters of bodies, and the ends of the last one


def bounds_of(body_set: BodySet) -> Bounds:
    """Return the first particle and the first loose cluster of each copy, and the ends of the last one."""
    first_particle = np.array([*(copy.first_particle for copy in body_set.copies), body_set.particle_count])
    firsts = np.array([*(copy.first_cluster for copy in body_set.copies), body_set.loose.count])
    firsts = np.minimum(firsts, body_set.loose.count)  # clusters of lattices come last, ...
    return first_particle, np.minimum.accumulate(firsts[::-1])[::-1]  # ... and none of theirs are loose


def blocks_of(sizes: np.ndarray) -> np.ndarray:
    """Return the start of each of `sizes` in whole blocks; the last number is the end."""
    starts: np.ndarray = np.concatenate([[0], np.cumsum(-(-sizes // LANES) * LANES)]).astype(np.int64)
    return starts


@dataclass(frozen=True, eq=False)
class Layout:
    """`slots` (particles,): place of each particle in a plane of `count`. `groups` (see loops.make_bodies_apart) and
    `work` (groups,), their cost in particles and entries.

    `arrays`: without materials; `of_particle`: (starts, clusters, rest offsets); `of_entry` and `of_particle_entry`:
    the entry whose factor is stored there, -1 for a ghost.
    """

    slots: np.ndarray
    count: int
    groups: np.ndarray
    work: np.ndarray
    arrays: ClusterArrays
    of_particle: tuple[np.ndarray, ...]
    of_entry: np.ndarray
    of_particle_entry: np.ndarray

    def kinds(self, whole: np.ndarray) -> np.ndarray:
        """Return (clusters,): LONE, SCATTERED or, if not `whole`, 0."""
        kinds = np.where(whole, SCATTERED, 0).astype(np.uint8)
        for _, _, low, high, lone in self.groups:
            kinds[low:high][whole[low:high]] = LONE if lone else SCATTERED
        return kinds

    def bands(self, threads: int) -> np.ndarray:
        """Return (threads + 1,): the first group of each thread, with the work divided as evenly as groups allow."""
        ends = np.concatenate([[0], np.cumsum(self.work)])
        inner = np.searchsorted(ends, ends[-1] * np.arange(1, threads) / threads - 0.5 * self.work.mean())
        return np.array([0, *inner, len(self.work)], np.int64)

    def evenness(self, threads: int) -> float:
        """Return the work of the busiest thread, relative to the mean."""
        ends = np.concatenate([[0], np.cumsum(self.work)])[self.bands(threads)]
        return float(np.diff(ends).max() * threads / max(1, ends[-1]))


def entries_of(clusters: Clusters, slots: np.ndarray, real: Real) -> tuple[ClusterArrays, np.ndarray]:
    """Return the arrays of clusters, assuming none of them to be straight, and the position of each entry in them."""
    sizes = np.diff(clusters.offsets)
    starts = blocks_of(sizes)
    place = np.arange(len(clusters.indices)) + np.repeat(starts[:-1] - clusters.offsets[:-1], sizes)
    firsts = np.zeros(clusters.count, np.int32) if not len(slots) else slots[first_particles(clusters)].astype(np.int32)
    entry_slots = np.repeat(firsts, np.diff(starts))
    entry_slots[place] = slots[clusters.indices]
    members = np.zeros((4, int(starts[-1])))
    members[:3, place], members[3, place] = clusters.rest.T, clusters.masses
    arrays = ClusterArrays(
        starts, firsts, np.zeros(clusters.count, np.uint8), entry_slots.astype(np.int32),
        members.astype(real).reshape(-1), leans(clusters, real).reshape(-1),
    )  # fmt: skip
    return arrays, place


def clusters_of_particles(clusters: Clusters, slots: np.ndarray, count: int) -> tuple[np.ndarray, ...]:
    """Return (starts (count + 1,), clusters, entries) of the particles at `slots` of `count` places, ghosts included."""
    offsets, entries = clusters.of_particle
    counts = np.zeros(count, np.int64)
    counts[slots] = np.diff(offsets)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return starts, clusters.owner[entries], entries.astype(np.int64)


def layout_of(clusters: Clusters, bounds: Bounds, real: Real, threads: int) -> Layout:
    """Return the layout of bodies, each with consecutive particles and clusters, in groups for `threads` threads."""
    first_particle, first_cluster = bounds
    particles, begins = np.diff(first_particle), blocks_of(np.diff(first_particle))
    count = int(begins[-1])
    slots = np.arange(first_particle[-1]) + np.repeat(begins[:-1] - first_particle[:-1], particles)
    sizes = np.diff(clusters.offsets)
    arrays, place = entries_of(clusters, slots, real)
    starts, firsts = arrays.starts, arrays.firsts
    body_end = np.repeat(begins[1:], np.diff(first_cluster))  # of each cluster's body
    steady = arrays.slots[place] == np.repeat(firsts - clusters.offsets[:-1], sizes) + np.arange(len(place))
    straight = np.bincount(clusters.owner, ~steady, clusters.count) == 0
    straight &= firsts + np.diff(starts) <= body_end
    of_entry = np.full(int(starts[-1]), -1)
    of_entry[place] = np.arange(len(place))

    particle_starts, owners, particle_entries = clusters_of_particles(clusters, slots, count)
    rest: np.ndarray = np.ascontiguousarray(clusters.rest[particle_entries], real).reshape(-1)
    of_particle = particle_starts, owners, rest
    arrays = arrays._replace(straight=straight.astype(np.uint8))

    one = (np.diff(first_cluster) == 1) & (particles > 0)
    lone = np.zeros(len(particles), bool)
    particle_cluster = first_cluster[:-1][one]
    lone[one] = straight[particle_cluster] & (sizes[particle_cluster] == particles[one])
    lone[one] &= np.bincount(clusters.owner, clusters.weights != 1, clusters.count)[particle_cluster] == 0
    work = particles + np.diff(clusters.offsets[first_cluster])
    groups, costs = [], []
    for first, last in _runs(lone, work, threads):
        groups.append((begins[first], begins[last], first_cluster[first], first_cluster[last], int(lone[first])))
        costs.append(work[first:last].sum())
    return Layout(
        slots, count, np.array(groups, np.int64).reshape(-1, 5), np.array(costs, np.int64), arrays, of_particle, of_entry,
        particle_entries,
    )  # fmt: skip


def _runs(lone: np.ndarray, work: np.ndarray, threads: int) -> list[tuple[int, int]]:
    """Return the first body and the one behind the last of each group: up to LANES lone ones, or a single other one; no
    group crosses the border of two threads."""
    thread = (np.cumsum(work) - work / 2) * threads // max(1, work.sum())
    runs: list[tuple[int, int]] = []
    first = 0
    while first < len(lone):
        last = first + 1
        if lone[first]:
            while last < len(lone) and lone[last] and thread[last] == thread[first]:
                last += 1
            parts = -(-(last - first) // LANES)
            edges = first + (last - first) * np.arange(parts + 1) // parts
            runs += [(int(a), int(b)) for a, b in pairwise(edges)]
        else:
            runs.append((first, last))
        first = last
    return runs
