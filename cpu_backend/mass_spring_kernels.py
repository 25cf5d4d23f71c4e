"""Fused kernels of the mass-spring grid: many steps in one call, one thread a band of rows.

Storage is a structure of arrays, (rows, columns) each, so that rows are contiguous and the compiler vectorises along
them. A band walks down its rows. Per row, each spring is computed once: the pull along the row goes into a row buffer,
the pull of the row below is carried to the next row as minus its pull up. Sums are taken in one fixed order,
(right + left) + (below + above), then gravity, external, manufactured, poke, damping. No mass is written by two
threads, none is read from the arrays being written, so there is nothing to lock: the end of the parallel loop is the
only synchronisation, and the result does not depend on the number of bands.

A kernel is compiled for the parts a scene has. Flags are closure constants: a part that is absent leaves no code.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from model.build import INDEX
from model.formulas import integrators, manufactured, random, springs

# rows of a band's scratch: pulls along the row, pulls from below for two rows in turn, two sums of accelerations
ALONG_X, ALONG_Y, BELOW_X, BELOW_Y, CLOSE_X, CLOSE_Y, OPEN_X, OPEN_Y = 0, 1, 2, 3, 6, 7, 8, 9
SCRATCH_ROWS = 10
SCRATCH_PADDING = 16  # of the rows' length, so that two bands never write to one cache line

BASE, STAGE_1, STAGE_2, TOTAL = 0, 1, 2, 3  # the states of RK4; each stage reads neighbours in one and writes another
SOURCE = (BASE, STAGE_1, STAGE_2, STAGE_1)
TARGET = (STAGE_1, STAGE_2, STAGE_1, BASE)

OPENING, MIDDLE, CLOSING = 0, 1, 2  # passes of velocity Verlet; one-force integrators know MIDDLE alone

K_DT, K_HALF_DT, K_HALF_DT_SQUARED = INDEX["dt"], INDEX["half_dt"], INDEX["half_dt_squared"]
K_SIXTH_DT, K_THIRD_DT = INDEX["sixth_dt"], INDEX["third_dt"]
K_STIFFNESS, K_REST, K_GRAVITY = INDEX["stiffness"], INDEX["stiffness_rest"], INDEX["gravity"]
K_DAMPING, K_INVERSE_DAMPING = INDEX["damping"], INDEX["inverse_damping"]
K_EXTERNAL, K_POKE_X, K_POKE_Y = INDEX["external"], INDEX["poke_x"], INDEX["poke_y"]
K_AMPLITUDE, K_INERTIA, K_SPACING = INDEX["amplitude"], INDEX["inertia"], INDEX["spacing"]


def variant_name(real: Any, math: str, integrator: str, parts: frozenset[str]) -> str:
    """A name, fit for a symbol, that tells every variant of a kernel apart."""
    words = [np.dtype(real).name, math, integrator.replace("-", "_"), *sorted(parts)]
    return "_".join(words)


def make_acceleration_row(compiler: Compiler, real: Any, integrator: str, parts: frozenset[str]) -> Any:
    """accelerate_row(...): the acceleration of every mass of a row, into the band's scratch."""
    compiled = compiler.compiled
    spring_pull_2d, damped = springs.make(real, compiled)
    philox = random.make_philox(compiled)
    external = random.make(real, compiled).add_external
    manufactured_acceleration, stage_time = manufactured.make(real, compiled)
    has_springs, has_gravity = "springs" in parts, "gravity" in parts
    has_external, has_manufactured, has_poke = "external" in parts, "manufactured" in parts, "poke" in parts
    has_damping = "damping" in parts and integrator != "velocity-verlet"
    two_sums = has_external and integrator == "velocity-verlet"  # its two kicks belong to different steps
    zero = real(0)

    @compiled
    def pull_along(x, y, count, stiffness, stiffness_rest, out_x, out_y):
        for j in range(count):
            pull_x, pull_y = spring_pull_2d(x[j + 1] - x[j], y[j + 1] - y[j], stiffness, stiffness_rest)
            out_x[j + 1] = pull_x
            out_y[j + 1] = pull_y

    @compiled
    def pull_from_below(x, y, x_below, y_below, count, stiffness, stiffness_rest, out_x, out_y):
        for j in range(count):
            pull_x, pull_y = spring_pull_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, stiffness_rest)
            out_x[j] = pull_x
            out_y[j] = pull_y

    @compiled
    def combine(along, below, above, count, constant, out):
        for j in range(count):
            out[j] = (along[j + 1] - along[j]) + (below[j] - above[j]) + constant

    @compiled
    def combine_alone(along, below, above, count, out):
        for j in range(count):
            out[j] = (along[j + 1] - along[j]) + (below[j] - above[j])

    @compiled
    def damp(velocity, count, rate, out):
        for j in range(count):
            out[j] = damped(out[j], velocity[j], rate)

    @compiled
    def add_external(out_x, out_y, count, first, step, seed, magnitude):
        for j in range(count):
            word_x, word_y, _, _ = philox(seed, np.uint64(step), np.uint64(first + j))
            out_x[j] = external(out_x[j], magnitude, word_x)
            out_y[j] = external(out_y[j], magnitude, word_y)

    @compiled
    def begin_band(first, x, y, columns, record, scratch):
        """The pull between row `first` and the row above it, which belongs to another band."""
        if has_springs:
            above = np.int64((first + 1) % 2)
            if first > 0:
                pull_from_below(
                    x[first - 1], y[first - 1], x[first], y[first], columns, record[K_STIFFNESS], record[K_REST],
                    scratch[BELOW_X + 2 * above], scratch[BELOW_Y + 2 * above],
                )  # fmt: skip
            else:
                scratch[BELOW_X + 2 * above, :] = zero
                scratch[BELOW_Y + 2 * above, :] = zero

    @compiled
    def accelerate_row(i, x, y, vx, vy, rows, columns, record, integers, step, offset, scratch):
        close_x, close_y = scratch[CLOSE_X], scratch[CLOSE_Y]
        if has_springs:
            below = np.int64(i % 2)
            above = np.int64((i + 1) % 2)
            along_x, along_y = scratch[ALONG_X], scratch[ALONG_Y]
            below_x, below_y = scratch[BELOW_X + 2 * below], scratch[BELOW_Y + 2 * below]
            above_x, above_y = scratch[BELOW_X + 2 * above], scratch[BELOW_Y + 2 * above]
            along_x[0] = zero
            along_y[0] = zero
            pull_along(x[i], y[i], columns - 1, record[K_STIFFNESS], record[K_REST], along_x, along_y)
            along_x[columns] = zero
            along_y[columns] = zero
            if i < rows - 1:
                pull_from_below(
                    x[i], y[i], x[i + 1], y[i + 1], columns, record[K_STIFFNESS], record[K_REST], below_x, below_y
                )
            else:
                below_x[:] = zero
                below_y[:] = zero
            combine_alone(along_x, below_x, above_x, columns, close_x)
            if has_gravity:
                combine(along_y, below_y, above_y, columns, record[K_GRAVITY], close_y)
            else:
                combine_alone(along_y, below_y, above_y, columns, close_y)
        else:
            close_x[:] = zero
            if has_gravity:
                close_y[:] = record[K_GRAVITY]
            else:
                close_y[:] = zero
        if two_sums:
            open_x, open_y = scratch[OPEN_X], scratch[OPEN_Y]
            open_x[:] = close_x
            open_y[:] = close_y
            add_external(open_x, open_y, columns, i * columns, step, integers[0], record[K_EXTERNAL])
            add_external(close_x, close_y, columns, i * columns, step - 1, integers[0], record[K_EXTERNAL])
        elif has_external:
            add_external(close_x, close_y, columns, i * columns, step, integers[0], record[K_EXTERNAL])
        if has_manufactured:
            time = stage_time(step, offset, record[K_DT])
            for j in range(columns):
                force_x, force_y = manufactured_acceleration(
                    i, j, rows, columns, time, record[K_AMPLITUDE], record[K_INERTIA], record[K_SPACING],
                    record[K_STIFFNESS], record[K_REST], record[K_GRAVITY], record[K_DAMPING],
                )  # fmt: skip
                close_x[j] += force_x
                close_y[j] += force_y
                if two_sums:
                    scratch[OPEN_X, j] += force_x
                    scratch[OPEN_Y, j] += force_y
        if has_poke:
            poked = np.int64(integers[1])  # 1 + particle, 0 for none
            if poked > 0 and (poked - 1) // columns == i:
                j = (poked - 1) % columns
                close_x[j] += record[K_POKE_X]
                close_y[j] += record[K_POKE_Y]
                if two_sums:
                    scratch[OPEN_X, j] += record[K_POKE_X]
                    scratch[OPEN_Y, j] += record[K_POKE_Y]
        if has_damping:
            damp(vx[i], columns, record[K_DAMPING], close_x)
            damp(vy[i], columns, record[K_DAMPING], close_y)

    return begin_band, accelerate_row, two_sums


@cache
def make_advance(real: Any, math: str, integrator: str, parts: frozenset[str]) -> Any:
    """The kernel of a variant.

    For one-force integrators and velocity Verlet:
    advance(passes, first_kind, last_kind, step, states, current, record, integers, pin_start, pin_column, scratches)
    does `passes` passes over the grid, ping-pong between the two states of `states` (2, 4, rows, columns: x, y, vx, vy),
    the first reading from `states[current]`. For rk4 see `make_advance_rk4`.
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
