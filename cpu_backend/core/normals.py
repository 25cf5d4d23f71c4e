"""Unit vertex normals of a cloth on CPU threads: one mass sums its up to six triangles, rows run in parallel."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.formulas.cloth import unit
from softlab.model.formulas.lengths import cross


@routine
def triangle_normal(state, i, j, upper):
    """Return the normal of a triangle of cell (i, j), (A, D, B) or (A, C, D), of twice its area; 0 outside the sheet."""
    rows, columns = state.shape[1], state.shape[2]
    if i < 0 or i >= rows - 1 or j < 0 or j >= columns - 1:
        return 0.0, 0.0, 0.0
    x, y, z = state[0, i, j], state[1, i, j], state[2, i, j]
    dx, dy, dz = state[0, i + 1, j + 1] - x, state[1, i + 1, j + 1] - y, state[2, i + 1, j + 1] - z
    if upper:
        return cross(dx, dy, dz, state[0, i, j + 1] - x, state[1, i, j + 1] - y, state[2, i, j + 1] - z)
    return cross(state[0, i + 1, j] - x, state[1, i + 1, j] - y, state[2, i + 1, j] - z, dx, dy, dz)


@routine
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@routine
def normals(state, out):
    """Write the normals; `state` (6, rows, columns), positions first; `out` (particles, 3).

    model/geometry/normals.py defines them.
    """
    for row in prange(state.shape[1]):
        i = np.int64(row)
        for j in range(state.shape[2]):
            central = plus(triangle_normal(state, i, j, False), triangle_normal(state, i, j, True))
            beside = plus(triangle_normal(state, i, j - 1, True), triangle_normal(state, i - 1, j, False))
            opposite = plus(triangle_normal(state, i - 1, j - 1, False), triangle_normal(state, i - 1, j - 1, True))
            x, y, z = plus(plus(central, beside), opposite)
            k = i * state.shape[2] + j
            out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)


@cache
def make_normals(real: Real) -> Callable:
    """Compile `normals`, always in `exact` math, so that drawing does not depend on the solver's."""
    compiler = Compiler(f"cloth_{np.dtype(real).name}", "exact")
    return compiler.kernel(compiler.variant_of(real).copied(normals))
