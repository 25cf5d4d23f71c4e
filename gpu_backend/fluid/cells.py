"""A fluid's particles in the order of their cells, and who is near to whom among them, on CUDA: launches alone, of sizes
fixed at the start, so that a graph can hold them.

What a launch of a substep moves, bytes a particle in float32 (c: cells a particle, about 1/6 in the fluid's inside; n:
neighbours, about 28 in space; the candidates of a search, 27 cells' particles or about 160, come from the caches):

| launch | reads | writes | bound by |
|---|---|---|---|
| bound (none where the prediction does it) | 16 | | memory |
| span | the blocks' boxes | the grid | its start |
| hash_particles | 16 | 8, one atomic | memory |
| chunks, totals | 4 c | 4 c | memory |
| fill | 12 + 4 c | 4 + 8 c | memory |
| arrange | 60 | 56 | memory |
| find | 20 | 4 n + 4 | the caches, 16 bytes a candidate; 9 flop each |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.device import simulated
from gpu_backend.fluid.sort_kernels import BOX, CHUNK, NUMBERS, REALS, THREADS, make_cell_sort

MOST_BOXES = 3 if simulated() else 1024  # blocks that look for the particles' box


def cell_bytes(particles: int, cells: int, neighbours: int, item: int) -> int:
    """Device memory for so many particles, cells and neighbours of a particle, `item` bytes a scalar."""
    return 4 * (5 * particles + 3 * cells + neighbours * particles) + item * BOX * MOST_BOXES


class Cells:
    """The grid of a fluid's particles.

    `found` (particles,) int32: how many neighbours each particle has; `table` (neighbours * particles,): the s-th of particle
    i in place s * particles + i, so that a warp's loads lie side by side.

    `most`: cells at most. `repeats`: axes whose sides do. `flow`: of gpu_backend/fluid/flow.py, where particles come and go;
    then `found` and numbers have one more at their end, how many are there.
    """

    launches = 7  # of a sort and a search, if something else looks for the box

    def __init__(self, real: Any, particles: int, neighbours: int, most: int, repeats: frozenset[str], stream: Any,
                 flow: Any = None):  # fmt: skip
        self._real, self._stream, self._most = real, stream, np.int32(most)
        self.limit = real(np.finfo(real).max)  # what is beyond, or no number, widens no grid
        self.blocks = min(MOST_BOXES, (particles + THREADS - 1) // THREADS)
        self.boxes = self._new(np.zeros(BOX * self.blocks, real))
        self.reals, self.numbers = self._new(np.zeros(REALS, real)), self._new(np.zeros(NUMBERS, np.int32))
        self._keys, self._slots, self._filled, self.sorted_keys = (self._integers(particles) for _ in range(4))
        self._flow, self.found = flow, self._integers(particles + (flow is not None))
        self._chunks = (most + CHUNK - 1) // CHUNK
        self._counts, self._starts, self.begins = (self._integers(most + extra) for extra in (0, 0, 1))
        self._totals = self._integers(self._chunks)
        self.table = cuda.device_array(neighbours * particles, np.int32, stream=stream)
        self.counts = self._new(np.zeros(2, np.int64))  # neighbours without room, velocities slowed
        self._flat = (particles + THREADS - 1) // THREADS, THREADS, stream
        self._sort = make_cell_sort(real, repeats, flow is not None)

    def _new(self, array: np.ndarray) -> Any:
        return cuda.to_device(array, stream=self._stream)

    def _integers(self, count: int) -> Any:
        return self._new(np.zeros(count, np.int32))

    def bound(self, position: Any) -> None:
        """The boxes of quads, where no other launch has left them."""
        self._sort.bound[self.blocks, THREADS, self._stream](position, self.limit, self.boxes)

    def sort(self, record: Any, given: Sequence[Any], into: Sequence[Any]) -> None:
        """(position, before, velocity: quads; number: int32) of particles whose boxes are known, in the order of cells."""
        kernels, flat, stream = self._sort, self._flat, self._stream
        kernels.span[1, THREADS, stream](self.boxes, record, self._most, self.reals, self.numbers)
        hashed = self._keys, self._slots, self._counts
        if self._flow is None:
            kernels.hash_particles[flat](given[0], self.reals, self.numbers, *hashed)
        else:
            ends = self._flow.sinks, self._flow.there
            self._flow.kernels.take[flat](given[0], given[-1], self.reals, self.numbers, *ends, *hashed)
        kernels.chunks[self._chunks, THREADS, stream](self._counts, self.numbers, self._starts, self._totals)
        kernels.totals[1, THREADS, stream](self.numbers, self._totals)
        counted = self._keys, self._slots, given[-1], self._starts, self._totals, self.numbers, self._counts
        kernels.fill[flat](*counted, self.begins, self._filled)
        kernels.arrange[flat](self._keys, self.begins, self._filled, *given, *into, self.sorted_keys)
        if self._flow is not None:
            self._flow.kernels.rest[1, 1, stream](self.numbers, into[-1], self.found)

    @property
    def lost(self) -> int:
        """How many neighbours were beyond those that a particle keeps, over all searches so far."""
        return self._count(0)

    @property
    def slowed(self) -> int:
        """How often the speed limit slowed a particle so far."""
        return self._count(1)

    def _count(self, which: int) -> int:
        host = self.counts.copy_to_host(stream=self._stream)
        cuda.synchronize()
        return int(host[which])

    def forget(self) -> None:
        """Nothing was lost or slowed so far."""
        self.counts.copy_to_device(np.zeros(2, np.int64), stream=self._stream)
