"""Peak arithmetic rate of this GPU, measured: the roofline of kernels that memory does not limit.

Every thread has eight independent numbers in registers and passes each through a chain of products and sums that the
compiler fuses. There are enough threads to fill each multiprocessor, and the results are stored, so that no computation
is removed.
"""

from __future__ import annotations

import time
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel
from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.model.base.types import Real
from softlab.model.base.variant import real, routine

THREADS = 256  # per block
BLOCKS_EACH = 16  # per multiprocessor
NUMBERS = 8  # per thread
UNROLLED = 4  # multiply-adds of a number per iteration of the loop
ROUNDS = 4096  # of the loop: milliseconds on a large device


@routine
def chains(out, rounds, factor, summand):
    """Write the sum of a thread's numbers."""
    k = cuda.grid(1)
    a = factor * real(k)
    b, c, d = a + summand, a - summand, a * factor
    e, f, g, h = b * factor, c * factor, d * factor, b + summand
    for _ in range(rounds):
        for _ in range(UNROLLED):
            a = a * factor + summand
            b = b * factor + summand
            c = c * factor + summand
            d = d * factor + summand
            e = e * factor + summand
            f = f * factor + summand
            g = g * factor + summand
            h = h * factor + summand
    out[k] = ((a + b) + (c + d)) + ((e + f) + (g + h))


@cache
def make_chains(real: Real) -> Kernel:
    """Compile `chains`; `out` (threads,)."""
    return cuda.jit(fastmath=True)(device_variant(real, "fast").copied(chains))


def arithmetic_rate(precision: str, budget: float = 0.1) -> float:
    """Return the operations/s of the whole device, a multiply-add counting as two: the best trial of `budget` seconds.

    `precision`: float32 or float64. Under the CUDA simulator one block does one round: a check, and no rate.
    """
    real: Real = np.dtype(precision).type
    kernel = make_chains(real)
    blocks, rounds = (
        (1, 1) if simulated() else (BLOCKS_EACH * int(cuda.get_current_device().MULTIPROCESSOR_COUNT), ROUNDS)
    )
    threads = 1 if simulated() else THREADS
    out = cuda.to_device(np.zeros(blocks * threads, real))
    arguments = out, np.int32(rounds), real(0.999), real(1e-3)

    def once() -> float:
        begin = time.perf_counter()
        kernel[blocks, threads](*arguments)
        cuda.synchronize()
        return time.perf_counter() - begin

    once()  # compiles and loads
    best, end, trials = float("inf"), time.perf_counter() + budget, 0
    while trials < 3 or time.perf_counter() < end:
        best, trials = min(best, once()), trials + 1
    return 2.0 * NUMBERS * UNROLLED * rounds * blocks * threads / best
