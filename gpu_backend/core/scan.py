"""Exclusive prefix sums of integers on CUDA, for a counting sort between counting and filling.

Each block sums its chunk in shared memory (W. D. Hillis, G. L. Steele, "Data parallel algorithms", CACM 29, 1986), one
block then sums the chunks' totals, one strip per thread, and all add theirs. Integers: the same sums in any order.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of
from softlab.gpu_backend.core.device import DeviceArray, Stream, simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.model.base.variant import FEATURE, routine

CHUNK = 32 if simulated() else 512  # numbers per block; the simulator runs each thread as a Python thread


@routine
def before(value):
    """Return the sum over the block's threads before this one.

    Every thread of a block of FEATURE.threads, a power of two, must call it.
    """
    memory = cuda.shared.array(2 * FEATURE.threads, np.int32)
    t = np.int32(cuda.threadIdx.x)
    memory[t] = value
    cuda.syncthreads()
    offset, side = np.int32(1), np.int32(0)
    while offset < np.int32(FEATURE.threads):
        total = memory[side + t]
        if t >= offset:
            total += memory[side + t - offset]
        side = np.int32(np.int32(FEATURE.threads) - side)
        memory[side + t] = total
        cuda.syncthreads()
        offset = np.int32(2 * offset)
    return np.int32(memory[side + t] - value)


@routine
def strips(sums, size):
    """Replace each of the first `size` numbers by the sum of those before it, one strip per thread, by all threads of a
    block of FEATURE.threads.

    It returns the sum before the thread's next strip, for the last thread the total.
    """
    strip = np.int32((size + FEATURE.threads - 1) // FEATURE.threads)
    first = np.int32(strip * cuda.threadIdx.x)
    last, total = min(np.int32(first + strip), size), np.int32(0)
    for k in range(first, last):
        total = np.int32(total + sums[k])
    start = before(total)
    for k in range(first, last):
        number = sums[k]
        sums[k] = start
        start = np.int32(start + number)
    return start


@routine
def chunks(counts, starts, totals):
    """Write starts[k], the sum of the chunk's counts before k, and totals[b], that of a chunk. One block per chunk."""
    k = np.int32(cuda.grid(1))
    value = counts[k] if k < counts.size else np.int32(0)
    start = before(value)
    if k < counts.size:
        starts[k] = start
    if cuda.threadIdx.x == CHUNK - 1:
        totals[cuda.blockIdx.x] = start + value


@routine
def totals(sums):
    """Replace the total of each chunk by the sum of those before it: one block."""
    strips(sums, np.int32(sums.size))


@routine
def add(starts, sums, cursors):
    """Add the chunks' sums, and write a copy for a counting sort to increment."""
    k = np.int32(cuda.grid(1))
    if k < cursors.size:
        starts[k] += sums[k // CHUNK]
        cursors[k] = starts[k]


@cache
def make_scan() -> SimpleNamespace:
    """Compile the kernels `chunks`, `totals` and `add`."""
    variant = device_variant(np.float32, "exact", {"threads": CHUNK})
    return kernels_of(variant, "exact", (chunks, totals, add), "scan")


class Scan:
    """Sums of `count` numbers, with memory allocated once."""

    def __init__(self, count: int, stream: Stream):
        self._blocks = (count + CHUNK - 1) // CHUNK
        self._stream = stream
        self._totals = cuda.to_device(np.zeros(self._blocks, np.int32), stream=stream)

    def run(self, counts: DeviceArray, starts: DeviceArray, cursors: DeviceArray) -> None:
        """Write the sum of the counts before each one to starts and cursors; device arrays (count,) int32."""
        kernels, launch = make_scan(), (self._blocks, CHUNK, self._stream)
        kernels.chunks[launch](counts, starts, self._totals)
        kernels.totals[1, CHUNK, self._stream](self._totals)
        kernels.add[launch](starts, self._totals, cursors)
