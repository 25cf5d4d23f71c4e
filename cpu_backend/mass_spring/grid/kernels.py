"""The kernel `fused` of the mass-spring grid: a team with one thread per band of rows (core/progress.py).

A band walks down its rows by mass_spring/grid/row_step.py. No mass is written by two threads, and none is read from the
state being written, so no locks are needed: the end of the parallel loop is the only synchronisation, and the result
does not depend on the number of bands. mass_spring/grid/persistent.py avoids the regions, mass_spring/grid/tiled.py
memory traffic; mass_spring/grid/rk4.py has the Runge-Kutta method, which has stages.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, PLANES, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.mass_spring.grid.row_step import pass_kind, step_row
from softlab.cpu_backend.mass_spring.grid.rows import SUM_ROWS, begin_walk, grid_kernel, variant_name
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

ABOVE_ROWS = 2  # of a walk: pulls along x and y, passed to the next row
SCRATCH_ROWS = ABOVE_ROWS + SUM_ROWS


@routine
def advance_band(band, kind, step, states, current, sheet, scratches):
    layout = sheet.layout
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // SCRATCH_ROWS
    first, last = rows * band // bands, rows * (band + 1) // bands
    source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
    above = scratches[band]
    sums = row_at(above, ABOVE_ROWS * width)
    blocks = (columns + BLOCK - 1) // BLOCK
    begin_walk(first, blocks, source, first * stride, stride, plane, sheet.parameters, above, width)
    for i in range(first, last):
        here = i * stride
        below = here + stride if i < rows - 1 else here
        step_row(
            kind, step, i, np.int64(0), blocks, source, here, below, plane, target, here, plane, above, sums, width,
            sheet,
        )  # fmt: skip


@routine
def advance(team, member, bands, passes, states, current, sheet, scratches):
    for k in range(passes.number):
        kind = pass_kind(k, passes)
        for band in assigned(team, member, bands):
            advance_band(np.int64(band), kind, passes.step + k, states, (current + k) % 2, sheet, scratches)


@cache
def make_advance(real: Real, math: str, integrator: str, parts: frozenset[str]) -> Callable:
    """Compile the kernel for one-force integrators and velocity Verlet.

    advance(bands, passes, states, current, sheet, scratches) does the passes of `passes` over the grid,
    alternating between the two states in the flat array `states` (core/layout.py); the first reads number `current`.
    `scratches`: SCRATCH_ROWS rows per band.
    """
    compiler = Compiler(variant_name("fused", real, math, integrator, parts), math)
    return compiler.team(grid_kernel(compiler, advance, real, integrator, parts))
