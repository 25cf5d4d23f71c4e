"""The kernel `team`: one parallel region for all the passes of a call, for grids so small that regions cost the most.

Each thread keeps its band of rows from the first pass to the last. Before a pass it waits for its two neighbours alone,
and for no more than their rows at its border: a band does its border rows first, says so, and then its inner rows, while
what it said travels. That flag at k means: the border rows of state k are there, and those of state k - 1, which pass k
overwrites, are no longer read.

Waiting needs every band on a thread of its own. They meet at a gate first: should they not come together, nothing is
done, and the caller takes another kernel.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from cpu_backend.layout import L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, PLANES, block_of, row_at
from cpu_backend.mass_spring_kernels import ABOVE_ROWS, SCRATCH_ROWS
from cpu_backend.progress import all_arrived, store_release, wait_for
from cpu_backend.row_step import make_row_step, pass_kind
from cpu_backend.rows import variant_name


@cache
def make_team_advance(real: Any, math: str, integrator: str, parts: frozenset[str]) -> Any:
    """advance(passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start, pin_column,
    scratches, progress, gate, spins): as the kernel `fused` (mass_spring_kernels.py), with one flag a band in
    `progress` and GATE_FLAGS in `gate`, all 0 (of a single pass none is looked at); `spins`: looks at a neighbour's flag
    before the processor is offered to others. If the gate ends at GIVE_UP, nothing was done. `scratches`:
    TEAM_SCRATCH_ROWS rows a band.
    """
    compiler = Compiler(variant_name("team", real, math, integrator, parts), math)
    begin_walk, step_row = make_row_step(compiler, real, integrator, parts)
    kind_of = compiler.compiled(pass_kind)
    block = block_of(real)

    @compiler.compiled
    def walk(
        start, end, kind, step, states, current, layout, record, integers, pin_start, pin_column, above, sums, width
    ):
        """Rows from `start` to before `end`, their walk begun."""
        rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
        blocks = (columns + block - 1) // block
        given = (layout, record, integers, pin_start, pin_column)
        for i in range(start, end):
            here = i * stride
            below = here + stride if i < rows - 1 else here
            step_row(
                kind, step, i, np.int64(0), blocks, source, here, below, plane, target, here, plane, above, sums, width,
                given,
            )  # fmt: skip

    @compiler.compiled
    def begin(i, states, current, layout, record, above, width):
        columns, stride, plane = layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        source = row_at(states, current * PLANES * plane)
        begin_walk(i, (columns + block - 1) // block, source, i * stride, stride, plane, record, above, width)

    @compiler.compiled
    def run_band(
        band, bands, passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start,
        pin_column, scratches, progress, spins,
    ):  # fmt: skip
        rows = layout[L_ROWS]
        width = np.int64(scratches.shape[1]) // TEAM_SCRATCH_ROWS
        first, last = rows * band // bands, rows * (band + 1) // bands
        above = scratches[band]
        sums = row_at(above, ABOVE_ROWS * width)
        above_border = row_at(above, SCRATCH_ROWS * width)
        for k in range(passes):
            kind, now, source = kind_of(k, passes, first_kind, last_kind), step + k, (current + k) % 2
            inner_first, inner_last = first, last
            if band > 0:
                wait_for(progress, band - 1, k, spins)
            if band < bands - 1:
                wait_for(progress, band + 1, k, spins)
            begin(first, states, source, layout, record, above, width)
            if band > 0:
                inner_first = first + 1
                walk(
                    first, inner_first, kind, now, states, source, layout, record, integers, pin_start, pin_column, above,
                    sums, width,
                )  # fmt: skip
            if band < bands - 1 and inner_first < last:
                inner_last = last - 1
                begin(inner_last, states, source, layout, record, above_border, width)
                walk(
                    inner_last, last, kind, now, states, source, layout, record, integers, pin_start, pin_column,
                    above_border, sums, width,
                )  # fmt: skip
            store_release(progress, band, k + 1)
            walk(
                inner_first, inner_last, kind, now, states, source, layout, record, integers, pin_start, pin_column, above,
                sums, width,
            )  # fmt: skip

    @compiler.compiled
    def enter(
        band, passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start, pin_column,
        scratches, progress, gate, spins,
    ):  # fmt: skip
        bands = np.int64(scratches.shape[0])
        if passes == 1 or all_arrived(gate, bands, spins):  # a single pass waits for nothing
            run_band(
                band, bands, passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start,
                pin_column, scratches, progress, spins,
            )  # fmt: skip

    def advance(
        passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start, pin_column, scratches,
        progress, gate, spins,
    ):  # fmt: skip
        for band in prange(scratches.shape[0]):
            enter(
                np.int64(band), passes, first_kind, last_kind, step, states, current, layout, record, integers, pin_start,
                pin_column, scratches, progress, gate, spins,
            )  # fmt: skip

    return compiler.kernel(advance)


TEAM_SCRATCH_ROWS = SCRATCH_ROWS + ABOVE_ROWS  # one more walk: that of the lower border row
