"""Fused kernels of the mass-spring grid: many steps in one call, one thread a band of rows.

A band walks down its rows; rows.py computes the accelerations of one. No mass is written by two threads, none is read
from the arrays being written, so there is nothing to lock: the end of the parallel loop is the only synchronisation, and
the result does not depend on the number of bands. rk4_kernels.py holds the Runge-Kutta method, which has stages.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from cpu_backend.rows import CLOSE_X, make_acceleration_row, variant_name
from model.formulas import integrators
from model.record import (
    K_DAMPING,
    K_DT,
    K_HALF_DT,
    K_HALF_DT_SQUARED,
    K_INVERSE_DAMPING,
)  # fmt: skip

OPENING, MIDDLE, CLOSING = 0, 1, 2  # passes of velocity Verlet; one-force integrators know MIDDLE alone


@cache
def make_advance(real: Any, math: str, integrator: str, parts: frozenset[str]) -> Any:
    """The kernel of a variant.

    For one-force integrators and velocity Verlet:
    advance(passes, first_kind, last_kind, step, states, current, record, integers, pin_start, pin_column, scratches)
    does `passes` passes over the grid, ping-pong between the two states of `states` (2, 4, rows, columns: x, y, vx, vy),
    the first reading from `states[current]`. For rk4 see rk4_kernels.py.
    """
    compiler = Compiler(variant_name(real, math, integrator, parts), math)
    compiled = compiler.compiled
    formulas = integrators.make(real, compiled)
    begin_band, accelerate_row, two_sums = make_acceleration_row(compiler, real, integrator, parts)
    has_pins = "pins" in parts
    verlet = integrator == "velocity-verlet"
    first_half, second_half = formulas.verlet_first_half, formulas.verlet_second_half
    one_force = formulas.semi_implicit_euler if verlet else getattr(formulas, integrator.replace("-", "_"))
    zero = real(0)

    @compiled
    def integrate(position, velocity, acceleration, count, record, new_position, new_velocity):
        dt, half_dt_squared = record[K_DT], record[K_HALF_DT_SQUARED]
        for j in range(count):
            p, v = one_force(position[j], velocity[j], acceleration[j], dt, half_dt_squared)
            new_position[j] = p
            new_velocity[j] = v

    @compiled
    def opening_kick(position, velocity, acceleration, count, record, new_position, new_velocity):
        dt, half_dt, rate = record[K_DT], record[K_HALF_DT], record[K_DAMPING]
        for j in range(count):
            p, v = first_half(position[j], velocity[j], acceleration[j], dt, half_dt, rate)
            new_position[j] = p
            new_velocity[j] = v

    @compiled
    def both_kicks(position, velocity, closing, opening, count, record, new_position, new_velocity):
        dt, half_dt, rate, inverse_damping = (
            record[K_DT],
            record[K_HALF_DT],
            record[K_DAMPING],
            record[K_INVERSE_DAMPING],
        )
        for j in range(count):
            whole = second_half(velocity[j], closing[j], half_dt, inverse_damping)
            p, v = first_half(position[j], whole, opening[j], dt, half_dt, rate)
            new_position[j] = p
            new_velocity[j] = v

    @compiled
    def closing_kick(position, velocity, acceleration, count, record, new_position, new_velocity):
        half_dt, inverse_damping = record[K_HALF_DT], record[K_INVERSE_DAMPING]
        for j in range(count):
            new_position[j] = position[j]
            new_velocity[j] = second_half(velocity[j], acceleration[j], half_dt, inverse_damping)

    @compiled
    def update_axis(kind, position, velocity, scratch, close, count, record, new_position, new_velocity):
        opening = close + 2 if two_sums else close
        if not verlet:
            integrate(position, velocity, scratch[close], count, record, new_position, new_velocity)
        elif kind == MIDDLE:
            both_kicks(position, velocity, scratch[close], scratch[opening], count, record, new_position, new_velocity)
        elif kind == OPENING:
            opening_kick(position, velocity, scratch[opening], count, record, new_position, new_velocity)
        else:
            closing_kick(position, velocity, scratch[close], count, record, new_position, new_velocity)

    @compiled
    def advance_band(band, kind, step, source, target, record, integers, pin_start, pin_column, scratches):
        rows, columns = np.int64(source.shape[1]), np.int64(source.shape[2])
        bands = np.int64(scratches.shape[0])
        first, last = rows * band // bands, rows * (band + 1) // bands
        scratch = scratches[band]
        x, y, vx, vy = source[0], source[1], source[2], source[3]
        begin_band(first, x, y, columns, record, scratch)
        for i in range(first, last):
            accelerate_row(i, x, y, vx, vy, rows, columns, record, integers, step, zero, scratch)
            for axis in range(2):
                update_axis(
                    kind, source[axis, i], source[2 + axis, i], scratch, CLOSE_X + axis, columns, record,
                    target[axis, i], target[2 + axis, i],
                )  # fmt: skip
            if has_pins:
                for k in range(pin_start[i], pin_start[i + 1]):
                    j = pin_column[k]
                    for axis in range(2):
                        target[axis, i, j] = source[axis, i, j]
                        target[2 + axis, i, j] = zero

    def advance(
        passes, first_kind, last_kind, step, states, current, record, integers, pin_start, pin_column, scratches
    ):
        bands = scratches.shape[0]
        for k in range(passes):
            kind = MIDDLE
            if k == passes - 1:
                kind = last_kind
            if k == 0:
                kind = first_kind
            source = (current + k) % 2
            for band in prange(bands):
                advance_band(
                    np.int64(band), kind, step + k, states[source], states[1 - source], record, integers, pin_start,
                    pin_column, scratches,
                )  # fmt: skip

    return compiler.kernel(advance)
