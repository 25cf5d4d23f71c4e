"""The lab's step as a scatter over springs on CPU threads, for bench/experiments/findings/determinism.py only.

Each spring is evaluated once and added to both of its masses. Two threads must not add to one mass at the same time, so
the springs are processed in four colours, within which no two share a mass: along a row the even ones, then the odd
ones (a row belongs to one thread, so both are one parallel region); down the columns those below even rows, then those
below odd ones. The forces on a mass are added in a fixed order, so any number of threads gives the same bits. The price
is memory traffic, for sums that every colour reads and writes, and a parallel region per colour.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import prange

from softlab.bench.experiments.findings.gather_cpu import GatherGrid
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import PLANES, row_at
from softlab.cpu_backend.mass_spring.grid.rows import variant_name
from softlab.model.base.types import Real
from softlab.model.formulas import integrators, springs

COLOURS = "colours"  # the kernel's name


def _make_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> tuple[Callable, Callable, Callable]:
    """Make (along, down, finish): every other spring of a row, the springs between two rows, and the step of a row."""
    formulas = compiler.formulas(springs, real)
    spring_acceleration_2d, damped = formulas.spring_acceleration_2d, formulas.damped
    lab = compiler.formulas(integrators, real).lab
    has_gravity, has_damping = "gravity" in parts, "damping" in parts
    zero = real(0)

    @compiler.row
    def along(count, x, y, parameters, sum_x, sum_y):
        """Add every other spring of a part of a row with `count` springs."""
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        for j in range(0, count, 2):
            pull_x, pull_y = spring_acceleration_2d(x[j + 1] - x[j], y[j + 1] - y[j], stiffness, rest)
            sum_x[j] += pull_x
            sum_y[j] += pull_y
            sum_x[j + 1] -= pull_x
            sum_y[j + 1] -= pull_y

    @compiler.row
    def down(columns, x, y, x_below, y_below, parameters, sum_x, sum_y, sum_x_below, sum_y_below):
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        for j in range(columns):
            pull_x, pull_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, rest)
            sum_x[j] += pull_x
            sum_y[j] += pull_y
            sum_x_below[j] -= pull_x
            sum_y_below[j] -= pull_y

    @compiler.row
    def finish(columns, x, y, vx, vy, parameters, sum_x, sum_y, new_x, new_y, new_vx, new_vy):
        """Step a row and reset its sums to 0."""
        dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
        for j in range(columns):
            ax, ay = sum_x[j], sum_y[j]
            if has_gravity:
                ay = ay + parameters.gravity
            if has_damping:
                ax, ay = damped(ax, vx[j], parameters.damping), damped(ay, vy[j], parameters.damping)
            new_x[j], new_vx[j] = lab(x[j], vx[j], ax, dt, half_dt_squared)
            new_y[j], new_vy[j] = lab(y[j], vy[j], ay, dt, half_dt_squared)
            sum_x[j] = zero
            sum_y[j] = zero

    return along, down, finish


@cache
def make_coloured(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make advance(steps, states, current, rows, columns, parameters, pin_start, pin_column, sums).

    It does `steps` steps, alternating between the two states (4 planes of rows x columns each) in the flat array
    `states`. `sums`: 2 planes of 0.
    """
    compiler = Compiler(variant_name(COLOURS, real, math, "lab", parts), math)
    along, down, finish = _make_rows(compiler, real, parts)
    zero = real(0)

    @compiler.compiled
    def along_row(i, columns, plane, source, parameters, sums):
        for odd in range(2):
            here = i * columns + odd
            along(
                columns - 1 - odd, row_at(source, here), row_at(source, here + plane), parameters, row_at(sums, here),
                row_at(sums, here + plane),
            )  # fmt: skip

    @compiler.compiled
    def down_row(i, columns, plane, source, parameters, sums):
        here, below = i * columns, (i + 1) * columns
        down(
            columns, row_at(source, here), row_at(source, here + plane), row_at(source, below),
            row_at(source, below + plane), parameters, row_at(sums, here), row_at(sums, here + plane), row_at(sums, below),
            row_at(sums, below + plane),
        )  # fmt: skip

    @compiler.compiled
    def finish_row(i, columns, plane, source, target, parameters, sums, pin_start, pin_column):
        here = i * columns
        x, y = row_at(source, here), row_at(source, here + plane)
        new_x, new_y = row_at(target, here), row_at(target, here + plane)
        new_vx, new_vy = row_at(target, here + 2 * plane), row_at(target, here + 3 * plane)
        finish(
            columns, x, y, row_at(source, here + 2 * plane), row_at(source, here + 3 * plane), parameters,
            row_at(sums, here), row_at(sums, here + plane), new_x, new_y, new_vx, new_vy,
        )  # fmt: skip
        for k in range(pin_start[i], pin_start[i + 1]):
            j = pin_column[k]
            new_x[j] = x[j]
            new_y[j] = y[j]
            new_vx[j] = zero
            new_vy[j] = zero

    def advance(steps, states, current, rows, columns, record, pin_start, pin_column, sums):
        plane = rows * columns
        for k in range(steps):
            here = (current + k) % 2
            source, target = row_at(states, here * PLANES * plane), row_at(states, (1 - here) * PLANES * plane)
            for i in prange(rows):
                along_row(np.int64(i), columns, plane, source, record[0], sums)
            for pair in prange(rows // 2):
                down_row(np.int64(2 * pair), columns, plane, source, record[0], sums)
            for pair in prange((rows - 1) // 2):
                down_row(np.int64(2 * pair + 1), columns, plane, source, record[0], sums)
            for i in prange(rows):
                finish_row(np.int64(i), columns, plane, source, target, record[0], sums, pin_start, pin_column)

    return compiler.kernel(advance)


class ColouredGrid(GatherGrid):
    """The same simulation by scattering, colour by colour."""

    kernel_name, make = COLOURS, staticmethod(make_coloured)

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return (np.zeros(2 * self.body.rows * self.body.columns, self.real),)
