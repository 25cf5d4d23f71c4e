"""Chebyshev acceleration of the sweeps of vertex block descent, on CPU threads."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.elastic.chebyshev import beyond


@routine
def accelerate_some(first, last, position, iterates, w):
    """Extrapolate particles after a sweep; `iterates` (2, particles, 4): positions after the last sweep, and after the one
    before it."""
    for k in range(first, last):
        if position[k, 3] > 0.0:
            for axis in range(3):
                x = beyond(position[k, axis], iterates[1, k, axis], w)
                iterates[1, k, axis] = iterates[0, k, axis]
                iterates[0, k, axis] = x
                position[k, axis] = x


@routine
def accelerate(band, bands, position, iterates, w):
    count = len(position)
    accelerate_some(count * band // bands, count * (band + 1) // bands, position, iterates, w)


@cache
def make_accelerate_stage(real: Real, math: str) -> Callable:
    """Compile accelerate(bands, position, iterates, w): one parallel loop."""
    compiler = Compiler(f"chebyshev_{np.dtype(real).name}_{math}", math)
    return compiler.banded(compiler.variant_of(real).copied(accelerate))
