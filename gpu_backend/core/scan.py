"""Exclusive prefix sums of whole numbers on CUDA: what a counting sort needs between counting and filling.

Each block sums a chunk of its own in shared memory (W. D. Hillis, G. L. Steele, "Data parallel algorithms", CACM 29, 1986),
one block then sums the chunks' totals, a strip a thread, and all add theirs. Whole numbers: the same sums in any order.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import make_kernels
from gpu_backend.core.device import simulated

CHUNK = 32 if simulated() else 512  # numbers of a block; the simulator runs each thread as one of Python's


@cache
def make_before(threads: int) -> Any:
    """before(own): what the block's threads before this one have together; every thread of a block of `threads`, a power of
    two, must call it."""
    two_copies, threads, zero = 2 * threads, np.int32(threads), np.int32(0)

    @cuda.jit(device=True)
    def before(own):
        memory = cuda.shared.array(two_copies, np.int32)
        t = np.int32(cuda.threadIdx.x)
        memory[t] = own
        cuda.syncthreads()
        reach, side = np.int32(1), zero
        while reach < threads:
            total = memory[side + t]
            if t >= reach:
                total += memory[side + t - reach]
            side = np.int32(threads - side)
            memory[side + t] = total
            cuda.syncthreads()
            reach = np.int32(2 * reach)
        return np.int32(memory[side + t] - own)

    return before


@cache
def make_strips(threads: int) -> Any:
    """strips(sums, size): each of the first `size` numbers becomes what comes before it, a strip a thread, by all threads of
    a block of `threads`; returned: what comes before the thread's next strip, of the last one all."""
    before, zero = make_before(threads), np.int32(0)

    @cuda.jit(device=True)
    def strips(sums, size):
        strip = np.int32((size + threads - 1) // threads)
        first = np.int32(strip * cuda.threadIdx.x)
        last, own = min(np.int32(first + strip), size), zero
        for k in range(first, last):
            own = np.int32(own + sums[k])
        start = before(own)
        for k in range(first, last):
            number = sums[k]
            sums[k] = start
            start = np.int32(start + number)
        return start

    return strips


@cache
def make_scan() -> SimpleNamespace:
    """The kernels `chunks`, `totals` and `add`."""
    zero, before, strips = np.int32(0), make_before(CHUNK), make_strips(CHUNK)

    def chunks(counts, starts, totals):
        """starts[k]: the sum of the chunk's counts before k; totals[b]: of a whole chunk. One block a chunk."""
        k = np.int32(cuda.grid(1))
        own = counts[k] if k < counts.size else zero
        start = before(own)
        if k < counts.size:
            starts[k] = start
        if cuda.threadIdx.x == CHUNK - 1:
            totals[cuda.blockIdx.x] = start + own

    def totals(sums):
        """The same in place, over all chunks: one block."""
        strips(sums, np.int32(sums.size))

    def add(starts, sums, cursors):
        """The chunks' sums added, and a copy for a counting sort to move on."""
        k = np.int32(cuda.grid(1))
        if k < cursors.size:
            starts[k] += sums[k // CHUNK]
            cursors[k] = starts[k]

    return make_kernels((chunks, totals, add), "scan")


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
        kernels.totals[1, CHUNK, self._stream](self._totals)
        kernels.add[launch](starts, self._totals, cursors)
