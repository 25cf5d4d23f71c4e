"""Bodies of voxels divided into slabs of whole layers across their longest side, a block of threads each.

A slab begins with an even layer. Even layers share no vertex with one another, nor do odd ones, and all even layers are
projected before all odd ones (model/tetrahedra/voxel_order.py). So a slab does its even layers alone, receives the
vertices of the common side from the next slab, does its odd layers, and sends those vertices back.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softlab.model.base.types import Real
from softlab.model.particles.constraints import ConstraintSet
from softlab.model.particles.tetrahedra_set import TetrahedraSet

HEADER = 8  # numbers of a slab in `tables`, by index:
LOCAL, ALL, LIST, SHARED, BORDER_BEFORE, BORDER_AFTER, STARTS = range(7)
ENOUGH_THREADS = 128  # per block, for vertices: more wait for one another longer than they save
MOST_THREADS = 384  # per block: a thread may use 168 registers then
QUADS = 2  # per vertex in shared memory: its position, its old position


@dataclass(frozen=True, eq=False)
class Slabs:
    """A set of constraints by slabs.

    Constraint `order[p]` of the set is at place p: slab by slab, colour by colour, in each the first constraints of all
    runs before the second ones. `corners` (constraints, 4) int32: vertices by their numbers in the slab: those that it
    shares with the slab before it, then the rest of its own, then those of the next slab that it needs, in that one's
    order.

    `tables` int32: for each slab HEADER numbers: its own vertices, all vertices that it stores, where in `tables` their
    particles are, how many of its own it shares with the slab before it, the first message about those and about
    vertices of the next slab, where in `tables` its `starts` are, and where the last one ends. `early`: number of
    colours of even layers; `borders`: number of vertices exchanged between slabs; `largest`: the most vertices stored
    in a slab; `widest`: the most runs of a colour in a slab.
    """

    count: int
    order: np.ndarray
    starts: np.ndarray
    corners: np.ndarray
    tables: np.ndarray
    colours: int
    early: int
    borders: int
    largest: int
    widest: int

    @property
    def threads(self) -> int:
        """Threads of a block: whole warps, one per run of a colour, but no more than MOST_THREADS."""
        return min(MOST_THREADS, -(-max(self.widest, min(self.largest, ENOUGH_THREADS)) // 32) * 32)

    def shared_bytes(self, real: Real) -> int:
        """Return the bytes of a block's shared memory."""
        return QUADS * 4 * self.largest * np.dtype(real).itemsize


def make_slabs(tetrahedra_set: TetrahedraSet, one: ConstraintSet, tetrahedra: np.ndarray, layers: int) -> Slabs:
    """Return the slabs, of `layers` each, an even number, of a set of voxels; `tetrahedra` (n,): those of its
    constraints."""
    first = tetrahedra[:: one.run]
    layer, body = tetrahedra_set.voxel[first, 0].astype(np.int64), tetrahedra_set.body[first].astype(np.int64)
    vertices = one.corners.reshape(len(first), -1)
    _, slab = np.unique(np.column_stack([body, layer // layers]), axis=0, return_inverse=True)
    slab = slab.reshape(-1)
    count = int(slab.max()) + 1
    owner = np.full(tetrahedra_set.particle_count, -1)
    odd = layer % 2 == 1
    owner[vertices[odd]] = slab[odd, None]
    owner[vertices[~odd]] = slab[~odd, None]
    lists, borders = _lists(vertices, slab, owner, count)
    colour = np.repeat(np.arange(one.colours), np.diff(one.starts) // one.run)
    order, starts = _places(slab * one.colours + colour, count * one.colours, one.run)
    corners = np.empty((len(tetrahedra), 4), np.int32)
    number = np.empty(tetrahedra_set.particle_count, np.int32)
    for k in range(count):
        number[np.concatenate(lists[k])] = np.arange(sum(map(len, lists[k])))
        here = slice(*(one.run * starts[[k * one.colours, (k + 1) * one.colours]]))
        corners[here] = number[one.corners[order[here]]]
    return Slabs(
        count, order, starts, corners, _tables(lists, borders, starts, one.colours), one.colours,
        int((~odd[one.starts[:-1] // one.run]).sum()), int(borders[-1]),
        max(sum(map(len, some)) for some in lists), int(np.diff(starts).max()),
    )  # fmt: skip


def _lists(
    vertices: np.ndarray, slab: np.ndarray, owner: np.ndarray, count: int
) -> tuple[list[tuple[np.ndarray, np.ndarray, np.ndarray]], np.ndarray]:
    """Return (for each slab its particles: shared with the one before, the rest of its own, of the next one, ascending;
    for each border its start in the messages (slabs + 1,): border k is before slab k)."""
    known = [np.unique(vertices[slab == k]) for k in range(count)]
    foreign = [some[owner[some] != k] for k, some in enumerate(known)]
    assert all((owner[some] == k + 1).all() for k, some in enumerate(foreign))
    shared = [known[0][:0], *foreign[:-1]]
    lists = [(shared[k], np.setdiff1d(some[owner[some] == k], shared[k]), foreign[k]) for k, some in enumerate(known)]
    return lists, np.cumsum([0, *map(len, shared)])


def _places(group: np.ndarray, groups: int, run: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (constraint at each place; first run of each group (groups + 1,)) of runs in groups."""
    runs = np.argsort(group, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(group, minlength=groups))])
    parts = [(runs[first:last] * run + np.arange(run)[:, None]).ravel() for first, last in pairwise(bounds)]
    return np.concatenate(parts), bounds


def _tables(
    lists: list[tuple[np.ndarray, np.ndarray, np.ndarray]], borders: np.ndarray, starts: np.ndarray, colours: int
) -> np.ndarray:
    """Return `tables` of Slabs."""
    head = np.zeros((len(lists), HEADER), np.int32)
    rest: list[np.ndarray] = []
    at = head.size
    for k, (shared, local, foreign) in enumerate(lists):
        places = starts[k * colours : (k + 1) * colours + 1]
        known = len(shared) + len(local) + len(foreign)
        head[k, [LOCAL, ALL, LIST, SHARED]] = known - len(foreign), known, at, len(shared)
        head[k, [BORDER_BEFORE, BORDER_AFTER, STARTS]] = borders[k], borders[k + 1], at + known
        rest += [shared, local, foreign, places]
        at += known + len(places)
    return np.concatenate([head.ravel(), *rest]).astype(np.int32)
