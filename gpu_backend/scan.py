"""Exclusive prefix sums of whole numbers on CUDA: what a counting sort needs between counting and filling.

Each block sums a chunk of its own in shared memory (W. D. Hillis, G. L. Steele, "Data parallel algorithms", CACM 29, 1986),
one thread then sums the chunks' totals, and all add theirs. Whole numbers: the same sums in any order.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.compile import make_kernel
from gpu_backend.device import simulated

CHUNK = 32 if simulated() else 512  # numbers of a block; the simulator runs each thread as one of Python's
TWO_COPIES = 2 * CHUNK


@cache
def make_scan() -> SimpleNamespace:
    """The kernels `chunks`, `totals` and `add`."""
    zero = np.int32(0)

    def chunks(counts, starts, totals):
        """starts[k]: the sum of the chunk's counts before k; totals[b]: of a whole chunk. One block a chunk."""
        memory = cuda.shared.array(TWO_COPIES, np.int32)
        t, k = np.int32(cuda.threadIdx.x), np.int32(cuda.grid(1))
        own = counts[k] if k < counts.size else zero
        memory[t] = own
        cuda.syncthreads()
        reach, side = np.int32(1), zero
        while reach < CHUNK:
            total = memory[side + t]
            if t >= reach:
                total += memory[side + t - reach]
            side = np.int32(CHUNK - side)
            memory[side + t] = total
            cuda.syncthreads()
            reach = np.int32(2 * reach)
        if k < counts.size:
            starts[k] = memory[side + t] - own
        if t == CHUNK - 1:
            totals[cuda.blockIdx.x] = memory[side + t]

    def totals(sums):
        """The same in place, over all chunks: one thread, since there are few."""
        if cuda.grid(1) == 0:
            before = zero
            for k in range(sums.size):
                own = sums[k]
                sums[k] = before
                before = np.int32(before + own)

    def add(starts, sums, cursors):
        """The chunks' sums added, and a copy for a counting sort to move on."""
        k = np.int32(cuda.grid(1))
        if k < cursors.size:
            starts[k] += sums[k // CHUNK]
            cursors[k] = starts[k]

    return SimpleNamespace(
        chunks=make_kernel(chunks, "scan"), totals=make_kernel(totals, "scan"), add=make_kernel(add, "scan")
    )


class Scan:
    """Sums of `count` numbers, its memory taken once."""

    def __init__(self, count: int, stream: Any):
        self._blocks = (count + CHUNK - 1) // CHUNK
        self._stream = stream
        self._totals = cuda.to_device(np.zeros(self._blocks, np.int32), stream=stream)

    def run(self, counts: Any, starts: Any, cursors: Any) -> None:
        """starts and cursors = what comes before each of the counts; device arrays (count,) int32."""
        kernels, launch = make_scan(), (self._blocks, CHUNK, self._stream)
        kernels.chunks[launch](counts, starts, self._totals)
        kernels.totals[1, 1, self._stream](self._totals)
        kernels.add[launch](starts, self._totals, cursors)
