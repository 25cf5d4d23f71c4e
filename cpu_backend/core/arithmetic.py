"""Peak arithmetic rate of this machine's cores, measured: the roofline of kernels that memory does not limit.

Each core works on a short row that fits in its first-level cache. A number is loaded once, passes through CHAIN
products and sums, which the compiler fuses where the processor can, and is stored once. The numbers of a row are
independent, so the vector units never wait for a result.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache

import numba
import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

CHAIN = 16  # multiply-adds between a load and its store
ROW = 512  # numbers: 4 KiB at most
REPEATS = 2000  # rows per call: a few 0.1 ms


@routine
def chain(row, factor, summand):
    for k in range(row.size):
        value = row[k]
        for _ in range(CHAIN):
            value = value * factor + summand
        row[k] = value


@routine
def chains(rows, repeats, factor, summand):
    """Update rows of `rows` (threads, ROW) `repeats` times, a thread each."""
    for thread in prange(rows.shape[0]):
        for _ in range(repeats):
            chain(rows[thread], factor, summand)


@cache
def _make_chains(real: Real) -> Callable:
    compiler = Compiler(f"{np.dtype(real).name}", "fast")
    return compiler.kernel(compiler.variant_of(real).copied(chains))


def arithmetic_rate(precision: str, threads: int, budget: float = 0.2) -> float:
    """Return the operations/s on `threads` threads, a multiply-add counting as two: the best trial of `budget` seconds.

    `precision`: float32 or float64.
    """
    real: Real = np.dtype(precision).type
    numba.set_num_threads(threads)
    rows: np.ndarray = np.ones((threads, ROW), real)
    kernel = _make_chains(real)
    arguments = rows, REPEATS, real(0.999), real(1e-3)  # fixed point 1: values neither grow nor become denormal
    kernel(*arguments)
    best, end, trials = float("inf"), time.perf_counter() + budget, 0
    while trials < 3 or time.perf_counter() < end:
        begin = time.perf_counter()
        kernel(*arguments)
        best, trials = min(best, time.perf_counter() - begin), trials + 1
    return 2.0 * CHAIN * ROW * REPEATS * threads / best
