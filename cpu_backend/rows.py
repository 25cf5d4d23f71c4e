"""The acceleration of a row of masses, for the fused kernels: each spring once, vectorised along the row.

Storage is a structure of arrays, (rows, columns) each, so that rows are contiguous. The pull along the row goes into a
row buffer, the pull of the row below is carried to the next row as minus its pull up. Sums are taken in one fixed order,
(right + left) + (below + above), then gravity, external, manufactured, poke, damping. Flags are closure constants: a
part that a scene lacks leaves no code.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.compile import Compiler
from model.formulas import manufactured, random, springs
from model.record import (
    K_AMPLITUDE,
    K_DAMPING,
    K_DT,
    K_EXTERNAL,
    K_GRAVITY,
    K_INERTIA,
    K_POKE_X,
    K_POKE_Y,
    K_SPACING,
    K_STIFFNESS,
    K_STIFFNESS_REST,
)  # fmt: skip

# rows of a band's scratch: pulls along the row, pulls from below for two rows in turn, two sums of accelerations
ALONG_X, ALONG_Y, BELOW_X, BELOW_Y, CLOSE_X, CLOSE_Y, OPEN_X, OPEN_Y = 0, 1, 2, 3, 6, 7, 8, 9
SCRATCH_ROWS = 10
SCRATCH_PADDING = 16  # of the rows' length, so that two bands never write to one cache line


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
                    x[first - 1], y[first - 1], x[first], y[first], columns, record[K_STIFFNESS], record[K_STIFFNESS_REST],
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
            pull_along(x[i], y[i], columns - 1, record[K_STIFFNESS], record[K_STIFFNESS_REST], along_x, along_y)
            along_x[columns] = zero
            along_y[columns] = zero
            if i < rows - 1:
                pull_from_below(
                    x[i],
                    y[i],
                    x[i + 1],
                    y[i + 1],
                    columns,
                    record[K_STIFFNESS],
                    record[K_STIFFNESS_REST],
                    below_x,
                    below_y,
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
                    record[K_STIFFNESS], record[K_STIFFNESS_REST], record[K_GRAVITY], record[K_DAMPING],
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
