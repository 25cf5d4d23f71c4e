"""Neighbour search among particles on CPU threads, for all interactions of nearby particles."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.contact.arrays import Lists, PairRows, Particles, Search, Sorted, Table
from softlab.cpu_backend.contact.particles_cells import AXES, BOX
from softlab.cpu_backend.contact.particles_find import PLACES, RUN_INTEGERS, make_find_stage
from softlab.cpu_backend.core.layout import aligned_zeros
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import MAX_NEIGHBOURS
from softlab.model.formulas.shape_matching.cluster import LANES

CELLS = 12  # cells of the table per particle; with fewer, a tall column of falling particles would wrap around


class Neighbours:
    """The neighbours of particles stored in planes of `count`, searched by `bands` threads.

    `body`, `kind` (count,) int32 and `rest` (3 count,): each particle's body, the kind of that body, and its rest
    position. Within a body, particles that are neighbours at rest are excluded. `kinds`: number of kinds; the rows of
    pairs in a record define which pairs of kinds are neighbours, and up to which distance
    (model/contact/particle_parameters.py).

    Lists are in the order of cells, then of numbers, the same for any number of threads. `lost`: neighbours beyond the
    MAX_NEIGHBOURS of a particle, since the object was made. `search`: the arrays of kernels, `stored` the result among
    them.
    """

    def __init__(
        self, real: Real, math: str, body: np.ndarray, kind: np.ndarray, rest: np.ndarray, kinds: int, bands: int
    ):
        self.bands, self.kinds, count = bands, kinds, len(body)
        cells, most, ahead = CELLS * max(count, LANES), count * MAX_NEIGHBOURS, count + LANES
        boxes, low, counts, holds = (np.zeros(n, np.int64) for n in (BOX * bands, AXES, AXES, 1))
        totals, begins, active, lost = (np.zeros(bands, np.int64) for _ in range(4))
        buckets, starts = np.zeros(count, np.int32), np.zeros(cells + 1, np.int32)
        table = Table(np.zeros(AXES * count, np.int32), boxes, low, counts, holds, buckets, starts, totals)
        order, bodies, runs = (np.zeros(n, np.int32) for n in (ahead, ahead, RUN_INTEGERS * bands))
        in_order = Sorted(order, aligned_zeros(PLACES * ahead, real), bodies, runs)
        who, entries = (np.zeros(n, np.uint32) for n in (count, most))  # unsigned: no check for negative indices
        many, pairs = np.zeros(count, np.int32), np.zeros(most, np.int32)
        self.pair_lists = Lists(who, many, entries, pairs, begins, active, lost)
        self.search = Search(Particles(body, kind, rest), table, in_order, self.pair_lists)
        self._find = make_find_stage(real, math)

    def find(self, position: np.ndarray, weights: np.ndarray, record: np.ndarray, search_radius: Any) -> None:
        """Search from `position`, three planes, flat. `weights` (count,): a particle of weight 0 has no neighbours.
        `record`, `search_radius`: rows of pairs, and the largest distance between neighbours."""
        self._find(self.bands, position, weights, PairRows(record, search_radius, self.kinds), self.search)

    @property
    def lost(self) -> int:
        return int(self.pair_lists.lost.sum())

    def lists(self) -> dict[int, list[int]]:
        """Return, by place of a particle, the places of its neighbours in their order, if it has any."""
        stored, lists = self.pair_lists, dict[int, list[int]]()
        for first, number in zip(stored.begins, stored.active, strict=True):
            entry = int(first) * MAX_NEIGHBOURS
            for n in range(int(first), int(first + number)):
                lists[int(stored.who[n])] = stored.entries[entry : entry + stored.numbers[n]].tolist()
                entry += int(stored.numbers[n])
        return lists
