"""The classical Runge-Kutta method on the grid: four passes per step, each as in mass_spring/grid/kernels.py."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, PLANES, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.mass_spring.grid.kernels import ABOVE_ROWS, SCRATCH_ROWS
from softlab.cpu_backend.mass_spring.grid.rows import (
    CLOSE_X,
    CLOSE_Y,
    add_later_parts,
    apply_pins,
    begin_walk,
    grid_kernel,
    place_ghosts,
    sum_row,
    variant_name,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.formulas.integrators import rk4_stage
from softlab.model.formulas.springs import damped

BASE, STAGE_1, STAGE_2, TOTAL = 0, 1, 2, 3  # the states; each stage reads one and writes another
SOURCE = (BASE, STAGE_1, STAGE_2, STAGE_1)
TARGET = (STAGE_1, STAGE_2, STAGE_1, BASE)


@row_routine
def first_stage(blocks, base, rate, derivative_dt, total_dt, total, out):
    for j in range(blocks * BLOCK):
        value, total_value = rk4_stage(base[j], rate[j], base[j], derivative_dt, total_dt)
        out[j] = value
        total[j] = total_value


@row_routine
def middle_stage(blocks, base, rate, derivative_dt, total_dt, total, out):
    for j in range(blocks * BLOCK):
        value, total_value = rk4_stage(base[j], rate[j], total[j], derivative_dt, total_dt)
        out[j] = value
        total[j] = total_value


@row_routine
def last_stage(blocks, total, rate, total_dt, out):
    for j in range(blocks * BLOCK):
        _, value = rk4_stage(0.0, rate[j], total[j], 0.0, total_dt)
        out[j] = value


@routine
def update(stage, blocks, base, rate, parameters, total, out):
    """Do stage `stage` of one unknown of a row of masses: from the sum of stages so far and the derivative `rate`, compute
    the next stage's value and the new sum; in the fourth stage the new state."""
    if stage == 0:
        first_stage(blocks, base, rate, parameters.half_dt, parameters.sixth_dt, total, out)
    elif stage == 1:
        middle_stage(blocks, base, rate, parameters.half_dt, parameters.third_dt, total, out)
    elif stage == 2:
        middle_stage(blocks, base, rate, parameters.dt, parameters.third_dt, total, out)
    else:
        last_stage(blocks, total, rate, parameters.sixth_dt, out)


@row_routine
def damp(blocks, velocity, parameters, out):
    for j in range(blocks * BLOCK):
        out[j] = damped(out[j], velocity[j], parameters.damping)


@routine
def stage_band(band, stage, step, states, sheet, scratches):
    layout, parameters = sheet.layout, sheet.parameters
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    bands, width = np.int64(scratches.shape[0]), np.int64(scratches.shape[1]) // SCRATCH_ROWS
    first, last = rows * band // bands, rows * (band + 1) // bands
    size = PLANES * plane
    base, total = row_at(states, BASE * size), row_at(states, TOTAL * size)
    source, target = row_at(states, SOURCE[stage] * size), row_at(states, TARGET[stage] * size)
    above = scratches[band]
    sums = row_at(above, ABOVE_ROWS * width)
    blocks = (columns + BLOCK - 1) // BLOCK
    begin_walk(first, blocks, source, first * stride, stride, plane, parameters, above, width)
    for i in range(first, last):
        here = i * stride
        below = here + stride if i < rows - 1 else here
        arguments = (
            row_at(source, here), row_at(source, here + plane), row_at(source, below), row_at(source, below + plane),
            0.0, 0.0, row_at(above, 0), row_at(above, width), parameters, row_at(sums, CLOSE_X * width),
            row_at(sums, CLOSE_Y * width),
        )  # fmt: skip
        sum_row(i, blocks, *arguments)
        if FEATURE.forced:
            add_later_parts(i, np.int64(0), blocks, layout, parameters, sheet.integers, step, sums, width)
        for axis in range(2):
            position, velocity = here + axis * plane, here + (2 + axis) * plane
            rate = row_at(sums, (CLOSE_X + axis) * width)
            if FEATURE.damped:
                damp(blocks, row_at(source, velocity), parameters, rate)
            update(
                stage, blocks, row_at(base, position), row_at(source, velocity), parameters, row_at(total, position),
                row_at(target, position),
            )  # fmt: skip
            update(
                stage, blocks, row_at(base, velocity), rate, parameters, row_at(total, velocity), row_at(target, velocity)
            )  # fmt: skip
        if FEATURE.pins:  # a pinned mass does not move, so any stage has its position
            apply_pins(i, np.int64(0), blocks, source, here, plane, target, here, plane, sheet)
        place_ghosts(np.int64(0), blocks, layout, target, here, plane)


@routine
def advance(team, member, bands, steps, step, states, sheet, scratches):
    for k in range(4 * steps):
        for band in assigned(team, member, bands):
            stage_band(np.int64(band), k % 4, step + k // 4, states, sheet, scratches)


@cache
def make_advance_rk4(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, states, sheet, scratches).

    The flat array `states` has, in this order (core/layout.py): the state, two stages used in turn, the running sum.
    Each step is four passes over the grid; the last writes the state, which is no longer read. `scratches`:
    SCRATCH_ROWS rows per band.
    """
    compiler = Compiler(variant_name("fused", real, math, "rk4", parts), math)
    return compiler.team(grid_kernel(compiler, advance, real, "rk4", parts))
