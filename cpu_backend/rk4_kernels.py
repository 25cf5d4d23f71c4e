"""The classical Runge-Kutta method on the grid: four passes a step, each as in mass_spring_kernels.py."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from cpu_backend.rows import CLOSE_X, make_acceleration_row, variant_name
from model.formulas import integrators
from model.record import (
    K_DT,
    K_HALF_DT,
    K_SIXTH_DT,
    K_THIRD_DT,
)  # fmt: skip

BASE, STAGE_1, STAGE_2, TOTAL = 0, 1, 2, 3  # the states; each stage reads neighbours in one and writes another
SOURCE = (BASE, STAGE_1, STAGE_2, STAGE_1)
TARGET = (STAGE_1, STAGE_2, STAGE_1, BASE)


@cache
def make_advance_rk4(real: Any, math: str, parts: frozenset[str]) -> Any:
    """advance(steps, step, states, record, integers, pin_start, pin_column, scratches).

    `states` is (4, 4, rows, columns): the state, two stages in turn, the running sum; x, y, vx, vy of each. Each step is
    four passes over the grid; the last writes the state, which nothing reads any more.
    """
    compiler = Compiler(variant_name(real, math, "rk4", parts), math)
    compiled = compiler.compiled
    rk4_stage = integrators.make(real, compiled).rk4_stage
    begin_band, accelerate_row, _ = make_acceleration_row(compiler, real, "rk4", parts)
    has_pins = "pins" in parts
    zero, half, one = real(0), real(0.5), real(1)

    @compiled
    def first_stage(base, rate, count, derivative_dt, total_dt, total, out):
        for j in range(count):
            value, total_value = rk4_stage(base[j], rate[j], base[j], derivative_dt, total_dt)
            out[j] = value
            total[j] = total_value

    @compiled
    def middle_stage(base, rate, count, derivative_dt, total_dt, total, out):
        for j in range(count):
            value, total_value = rk4_stage(base[j], rate[j], total[j], derivative_dt, total_dt)
            out[j] = value
            total[j] = total_value

    @compiled
    def last_stage(total, rate, count, total_dt, out):
        for j in range(count):
            _, value = rk4_stage(zero, rate[j], total[j], zero, total_dt)
            out[j] = value

    @compiled
    def update(stage, base, rate, count, record, total, out):
        if stage == 0:
            first_stage(base, rate, count, record[K_HALF_DT], record[K_SIXTH_DT], total, out)
        elif stage == 1:
            middle_stage(base, rate, count, record[K_HALF_DT], record[K_THIRD_DT], total, out)
        elif stage == 2:
            middle_stage(base, rate, count, record[K_DT], record[K_THIRD_DT], total, out)
        else:
            last_stage(total, rate, count, record[K_SIXTH_DT], out)

    @compiled
    def stage_band(band, stage, step, states, record, integers, pin_start, pin_column, scratches):
        source, base, total = states[SOURCE[stage]], states[BASE], states[TOTAL]
        out = states[TARGET[stage]]
        rows, columns = np.int64(base.shape[1]), np.int64(base.shape[2])
        bands = np.int64(scratches.shape[0])
        first, last = rows * band // bands, rows * (band + 1) // bands
        scratch = scratches[band]
        x, y, vx, vy = source[0], source[1], source[2], source[3]
        offset = zero
        if stage == 1 or stage == 2:
            offset = half
        elif stage == 3:
            offset = one
        begin_band(first, x, y, columns, record, scratch)
        for i in range(first, last):
            accelerate_row(i, x, y, vx, vy, rows, columns, record, integers, step, offset, scratch)
            for axis in range(2):
                update(stage, base[axis, i], source[2 + axis, i], columns, record, total[axis, i], out[axis, i])
                update(
                    stage, base[2 + axis, i], scratch[CLOSE_X + axis], columns, record, total[2 + axis, i],
                    out[2 + axis, i],
                )  # fmt: skip
            if has_pins:
                for k in range(pin_start[i], pin_start[i + 1]):
                    j = pin_column[k]
                    for axis in range(2):  # a pinned mass stands still, so any stage holds its place
                        out[axis, i, j] = source[axis, i, j]
                        out[2 + axis, i, j] = zero

    def advance(steps, step, states, record, integers, pin_start, pin_column, scratches):
        bands = scratches.shape[0]
        for k in range(4 * steps):
            for band in prange(bands):
                stage_band(
                    np.int64(band), k % 4, step + k // 4, states, record, integers, pin_start, pin_column, scratches
                )

    return compiler.kernel(advance)
