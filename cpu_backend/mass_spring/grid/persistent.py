"""The kernel `team`: one parallel region for all passes of a call; bands wait for their neighbours only.

Each thread has its band of rows from the first pass to the last. Before a pass it waits for its two neighbours only,
and for their border rows only: a band does its border rows first, sets a flag, and then does its inner rows while the
flag travels. The flag BORDER at k means: the border rows of state k are complete, and those of state k - 1, which pass
k overwrites, are no longer read. DONE at k: so are all its rows. The band's first flag counts the passes that were
begun.

A thread that has waited for a while does a pass of any band that can begin and was not begun, so that a descheduled
thread does not stall the others, and nothing is lost if a threading layer runs threads in sequence.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, PLANES, row_at
from softlab.cpu_backend.core.progress import SPINS, bide, exchange, load_acquire, store_release
from softlab.cpu_backend.mass_spring.grid.kernels import ABOVE_ROWS, SCRATCH_ROWS
from softlab.cpu_backend.mass_spring.grid.row_step import pass_kind, step_row
from softlab.cpu_backend.mass_spring.grid.rows import begin_walk, grid_kernel, variant_name
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

TEAM_FLAGS, BORDER, DONE = 3, 1, 2
TEAM_SCRATCH_ROWS = SCRATCH_ROWS + ABOVE_ROWS  # one more walk: that of the lower border row


@routine
def walk(start, end, kind, step, states, current, sheet, above, sums, width):
    """Do the rows from `start` to before `end` of a walk that has begun."""
    layout = sheet.layout
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
    blocks = (columns + BLOCK - 1) // BLOCK
    for i in range(start, end):
        here = i * stride
        below = here + stride if i < rows - 1 else here
        step_row(
            kind, step, i, np.int64(0), blocks, source, here, below, plane, target, here, plane, above, sums, width,
            sheet,
        )  # fmt: skip


@routine
def begin(i, states, current, sheet, above, width):
    columns, stride, plane = sheet.layout[L_COLUMNS], sheet.layout[L_STRIDE], sheet.layout[L_PLANE]
    source = row_at(states, current * PLANES * plane)
    begin_walk(
        i,
        (columns + BLOCK - 1) // BLOCK,
        source,
        i * stride,
        stride,
        plane,
        sheet.parameters,
        above,
        width,
    )


@routine
def pass_band(band, bands, k, passes, states, current, sheet, scratches, progress):
    """Do pass k of a band, and set its flags."""
    rows = sheet.layout[L_ROWS]
    width = np.int64(scratches.shape[1]) // TEAM_SCRATCH_ROWS
    first, last = rows * band // bands, rows * (band + 1) // bands
    above = scratches[band]
    sums = row_at(above, ABOVE_ROWS * width)
    above_border = row_at(above, SCRATCH_ROWS * width)
    kind, now, source = pass_kind(k, passes), passes.step + k, (current + k) % 2
    inner_first, inner_last = first, last
    begin(first, states, source, sheet, above, width)
    if band > 0:
        inner_first = first + 1
        walk(first, inner_first, kind, now, states, source, sheet, above, sums, width)
    if band < bands - 1 and inner_first < last:
        inner_last = last - 1
        begin(inner_last, states, source, sheet, above_border, width)
        walk(inner_last, last, kind, now, states, source, sheet, above_border, sums, width)
    store_release(progress, BORDER * bands + band, k + 1)
    walk(inner_first, inner_last, kind, now, states, source, sheet, above, sums, width)
    store_release(progress, DONE * bands + band, k + 1)


@routine
def taken(band, bands, k, progress):
    """Take the band's pass k if it can begin and was not begun. Returns True if the caller now has it."""
    border = BORDER * bands + band
    if load_acquire(progress, band) != k or (band > 0 and load_acquire(progress, border - 1) < k):
        return False
    if band < bands - 1 and load_acquire(progress, border + 1) < k:
        return False
    return exchange(progress, band, k, k + 1)


@routine
def advance(team, member, bands, passes, states, current, sheet, scratches, progress):
    patience, checks, left, stepped_in = np.int64(SPINS), 0, True, False
    while left:
        left, worked = False, False
        for n in range(bands):
            band = (member + n) % bands
            k = load_acquire(progress, DONE * bands + band)
            left = left or k < passes.number
            if k < passes.number and (n == 0 or checks >= patience) and taken(band, bands, k, progress):
                pass_band(band, bands, k, passes, states, current, sheet, scratches, progress)
                if n > 0:
                    patience, stepped_in = patience // 2, True
                else:
                    patience, stepped_in = patience if stepped_in else np.int64(SPINS), False
                worked = True
                break
        if worked:
            checks = 0
        elif left:
            bide(checks, SPINS)
            checks += 1


@cache
def make_team_advance(real: Real, math: str, integrator: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, passes, states, current, sheet, scratches, progress), as the kernel `fused`
    (mass_spring/grid/kernels.py).

    `progress`: TEAM_FLAGS flags per band, all 0; `scratches`: TEAM_SCRATCH_ROWS rows per band.
    """
    compiler = Compiler(variant_name("team", real, math, integrator, parts), math)
    return compiler.team(grid_kernel(compiler, advance, real, integrator, parts))
