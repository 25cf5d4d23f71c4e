"""Cell sort and neighbour search of a fluid's particles on CUDA, by launches of fixed sizes, which a graph can contain.

Bytes per particle of each launch of a substep in float32 (c: cells per particle, about 1/6 inside the fluid; n:
neighbours, about 28 in space; the candidates of a search, the particles of 27 cells or about 160, come from the
caches):

| launch | reads | writes | bound by |
|---|---|---|---|
| bound (not launched if the prediction does it) | 16 | | memory |
| span | the blocks' boxes | the grid | launch overhead |
| hash_particles | 16 | 8, one atomic | memory |
| chunks, totals | 4 c | 4 c | memory |
| fill | 12 + 4 c | 4 + 8 c | memory |
| arrange | 60 | 56 | memory |
| find | 20 | 4 n + 4 | the caches, 16 bytes per candidate; 9 flop each |
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import DeviceArray, Stream, simulated
from softlab.gpu_backend.fluid.sort_kernels import BOX, CHUNK, NUMBERS, REALS, THREADS, make_cell_sort
from softlab.model.base.types import Real

MOST_BOXES = 3 if simulated() else 1024  # blocks that compute the particles' bounding box


def cell_bytes(particles: int, cells: int, neighbours: int, item: int) -> int:
    """Return the device memory [bytes] for so many particles, cells and neighbours of a particle; `item`: bytes per
    scalar."""
    return 4 * (5 * particles + 3 * cells + neighbours * particles) + item * BOX * MOST_BOXES


class Particles(NamedTuple):
    """Arrays of particles that the sort moves: positions, positions at the substep's start, velocities (quads),
    numbers."""

    position: DeviceArray
    before: DeviceArray
    velocity: DeviceArray
    number: DeviceArray


class Cells:
    """The grid of a fluid's particles, and their neighbour lists.

    `found` (particles,) int32: number of neighbours of each particle; `table` (neighbours * particles,): neighbour s of
    particle i at index s * particles + i, so that a warp's loads are contiguous. `most`: maximum number of cells.
    `repeats`: axes that are periodic. `flow`: of gpu_backend/fluid/flow.py, with emitters or sinks; then `found` and
    the numbers have one more entry at the end, the number of active particles.
    """

    def __init__(self, real: Real, particles: int, neighbours: int, most: int, repeats: frozenset[str], stream: Stream,
                 flow: Any = None):  # fmt: skip
        self._real, self._stream, self._most = real, stream, np.int32(most)
        self.limit = real(np.finfo(real).max)  # particles beyond, and NaN, do not extend the grid
        self.blocks = min(MOST_BOXES, (particles + THREADS - 1) // THREADS)
        self.boxes = self._new(np.zeros(BOX * self.blocks, real))
        self.reals, self.numbers = self._new(np.zeros(REALS, real)), self._new(np.zeros(NUMBERS, np.int32))
        self._keys, self._slots, self._filled, self.sorted_keys = (self._integers(particles) for _ in range(4))
        self._flow, self.neighbour_counts = flow, self._integers(particles + (flow is not None))
        self._chunks = (most + CHUNK - 1) // CHUNK
        self._counts, self._starts, self.begins = (self._integers(most + extra) for extra in (0, 0, 1))
        self._totals = self._integers(self._chunks)
        self.table = cuda.device_array(neighbours * particles, np.int32, stream=stream)
        self.counts = self._new(np.zeros(2, np.int64))  # neighbours that did not fit, velocities slowed
        self._flat = (particles + THREADS - 1) // THREADS, THREADS, stream
        self._sort = make_cell_sort(real, repeats, flow is not None)

    def _new(self, array: np.ndarray) -> DeviceArray:
        return cuda.to_device(array, stream=self._stream)

    def _integers(self, count: int) -> DeviceArray:
        return self._new(np.zeros(count, np.int32))

    @property
    def sorting(self) -> int:
        """Number of launches of `sort`."""
        return 6 + (self._flow is not None)

    def bound(self, position: DeviceArray) -> None:
        """Compute the bounding boxes of quads, if no other launch has done it."""
        self._sort.bound[self.blocks, THREADS, self._stream](position, self.limit, self.boxes)

    def sort(self, record: DeviceArray, particles: Particles, into: Particles) -> None:
        """Sort particles, whose boxes are known, into the order of cells."""
        kernels, flat, stream = self._sort, self._flat, self._stream
        kernels.span[1, THREADS, stream](self.boxes, record, self._most, self.reals, self.numbers)
        hashed = self._keys, self._slots, self._counts
        if self._flow is None:
            kernels.hash_particles[flat](particles.position, self.reals, self.numbers, *hashed)
        else:
            ends = self._flow.sinks, self._flow.there
            self._flow.kernels.take[flat](
                particles.position, particles.number, self.reals, self.numbers, *ends, *hashed
            )
        kernels.chunks[self._chunks, THREADS, stream](self._counts, self.numbers, self._starts, self._totals)
        kernels.totals[1, THREADS, stream](self.numbers, self._totals)
        counted = self._keys, self._slots, particles.number, self._starts, self._totals, self.numbers, self._counts
        kernels.fill[flat](*counted, self.begins, self._filled)
        kernels.arrange[flat](self._keys, self.begins, self._filled, *particles, *into, self.sorted_keys)
        if self._flow is not None:
            self._flow.kernels.rest[1, 1, stream](self.numbers, into.number, self.neighbour_counts)

    @property
    def lost(self) -> int:
        """Number of neighbours that did not fit into the lists, over all searches so far."""
        return self._count(0)

    @property
    def slowed(self) -> int:
        """Number of times that the speed limit slowed a particle so far."""
        return self._count(1)

    def _count(self, which: int) -> int:
        host = self.counts.copy_to_host(stream=self._stream)
        cuda.synchronize()
        return int(host[which])

    def forget(self) -> None:
        """Set both counters to 0."""
        self.counts.copy_to_device(np.zeros(2, np.int64), stream=self._stream)
