"""Chebyshev acceleration of the sweeps of vertex block descent, on CPU threads."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import chebyshev


def make_accelerate(compiler: Compiler, real: Real) -> Callable:
    """Make accelerate(first, last, position, iterates, w): it extrapolates particles after a sweep; `iterates` (2, particles,
    4): positions after the last sweep, and after the one before it."""
    beyond, zero = compiler.formulas(chebyshev, real).beyond, real(0)

    @compiler.compiled
    def accelerate(first, last, position, iterates, w):
        for k in range(first, last):
            if position[k, 3] > zero:
                for axis in range(3):
                    x = beyond(position[k, axis], iterates[1, k, axis], w)
                    iterates[1, k, axis] = iterates[0, k, axis]
                    iterates[0, k, axis] = x
                    position[k, axis] = x

    return accelerate


@cache
def make_accelerate_stage(real: Real, math: str) -> Callable:
    """Compile accelerate(bands, position, iterates, w): one parallel loop."""
    compiler = Compiler(f"chebyshev_{np.dtype(real).name}_{math}", math)
    some = make_accelerate(compiler, real)

    def accelerate(band, bands, position, iterates, w):
        count = len(position)
        some(count * band // bands, count * (band + 1) // bands, position, iterates, w)

    return compiler.banded(accelerate)
