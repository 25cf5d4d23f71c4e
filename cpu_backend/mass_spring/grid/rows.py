"""Accelerations of a row of masses, for all kernels but `stages`: each spring once, vectorised along the row.

core/layout.py defines the storage. A walk goes down the rows: the pull along a row is passed from mass to mass, the
pull of the row below is passed to the next row, where it is minus the pull up. Sums have one fixed order, (right +
left) + (below + above), then gravity, external, poke, damping. A part that a scene lacks leaves no code.

Where every second spring is stiffer, the stiffness of a spring follows from its lower end: odd columns along a row, odd
rows down a column. Parts of a row begin at whole blocks of columns, an even number, so a column has the parity of its
index in the part.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, row_at
from softlab.cpu_backend.core.own_forces import add_2d, with_forces
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, routine, row_routine
from softlab.model.core.integrators import step_formula
from softlab.model.formulas.springs import spring_acceleration_2d
from softlab.model.mass_spring.plan import sheet_features

# rows of accelerations of a band: two sums for the step, and two for the step before (velocity Verlet)
CLOSE_X, CLOSE_Y, OPEN_X, OPEN_Y = range(4)
SUM_ROWS = 4


def variant_name(kernel: str, real: Real, math: str, integrator: str, parts: frozenset[str]) -> str:
    """Return a unique name of a kernel's variant, valid as a symbol."""
    words = [kernel, np.dtype(real).name, math, integrator.replace("-", "_"), *sorted(parts)]
    return "_".join(words)


def grid_kernel(compiler: Compiler, kernel: Callable, real: Real, integrator: str, parts: frozenset[str]) -> Callable:
    """Return a copy of a kernel of the grid for a scene's `parts`, which the compiler compiles."""
    variant = compiler.variant_of(real, sheet_features(integrator, parts) | {"axes": 2})
    return variant.copied(with_forces(filled(kernel, {"one_force": step_formula(integrator)}), parts))


@routine
def sum_accelerations(right, left, below, above):
    return (right - left) + (below - above)


@routine
def with_gravity(acceleration, parameters):
    if FEATURE.gravity:
        return acceleration + parameters.gravity
    return acceleration


@routine
def spring_constants(lower, parameters):
    """Return (stiffness, stiffness * rest length), both over mass, of a spring from row or column `lower` to the
    next."""
    if FEATURE.alternating:
        if lower & 1:
            return parameters.stiff, parameters.stiff_rest
    return parameters.stiffness, parameters.stiffness_rest


@row_routine
def pull_from_below(i, blocks, x, y, x_below, y_below, parameters, out_x, out_y):
    """Write the spring forces on the masses of row `i` from the row below. The row below gets the same forces with the
    opposite sign."""
    stiffness, rest = spring_constants(i, parameters)
    for j in range(blocks * BLOCK):
        pull_x, pull_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, rest)
        out_x[j] = pull_x
        out_y[j] = pull_y


@routine
def pull_from_left(source, here, plane, column, parameters):
    """Return the pull between the first mass of a part of a row and the one left of it: (0, 0) at the grid's
    edge."""
    if FEATURE.springs and column > 0:
        stiffness, rest = spring_constants(column - 1, parameters)
        return spring_acceleration_2d(
            source[here] - source[here - 1], source[here + plane] - source[here + plane - 1], stiffness, rest
        )  # fmt: skip
    return 0.0, 0.0


@row_routine
def sum_row(i, blocks, x, y, x_below, y_below, left_x, left_y, above_x, above_y, parameters, close_x, close_y):
    """Sum springs and gravity of row `i` into `close`.

    At entry `above` has the pulls between this row and the one above, at exit those between it and the one below.
    The last row is its own row below, which does not pull.
    """
    soft, soft_rest = spring_constants(0, parameters)
    stiff, stiff_rest = spring_constants(1, parameters)
    down, down_rest = spring_constants(i, parameters)
    for j in range(blocks * BLOCK):
        ax, ay = 0.0, 0.0
        if FEATURE.springs:
            odd = FEATURE.alternating and j & 1
            across, across_rest = stiff if odd else soft, stiff_rest if odd else soft_rest
            right_x, right_y = spring_acceleration_2d(x[j + 1] - x[j], y[j + 1] - y[j], across, across_rest)
            below_x, below_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], down, down_rest)
            ax = sum_accelerations(right_x, left_x, below_x, above_x[j])
            ay = sum_accelerations(right_y, left_y, below_y, above_y[j])
            left_x, left_y = right_x, right_y
            above_x[j] = below_x
            above_y[j] = below_y
        close_x[j] = ax
        close_y[j] = with_gravity(ay, parameters)


@routine
def begin_walk(i, blocks, source, here, stride, plane, parameters, above, width):
    """Compute the pulls between row `i`, where a walk begins, and the row above it; `here`: offset of row i."""
    if FEATURE.springs:
        above_x, above_y = row_at(above, 0), row_at(above, width)
        if i > 0:
            up = here - stride
            both = (
                row_at(source, up), row_at(source, up + plane), row_at(source, here), row_at(source, here + plane),
            )  # fmt: skip
            pull_from_below(i - 1, blocks, *both, parameters, above_x, above_y)
        else:
            for j in range(blocks * BLOCK):
                above_x[j] = 0.0
                above_y[j] = 0.0


@routine
def add_later_parts(i, column, blocks, layout, parameters, integers, step, sums, width):
    """Add the forces on single particles to the sums of row `i` from `column` on."""
    columns = layout[L_COLUMNS]
    count = min(blocks * BLOCK, columns - column)
    close_x, close_y = row_at(sums, CLOSE_X * width), row_at(sums, CLOSE_Y * width)
    open_x, open_y = row_at(sums, OPEN_X * width), row_at(sums, OPEN_Y * width)
    if FEATURE.changing and FEATURE.verlet:
        for j in range(count):
            open_x[j] = close_x[j]
            open_y[j] = close_y[j]
        add_2d(count, i * columns + column, step, parameters, integers, open_x, open_y)
    if FEATURE.forced:
        closing = step - 1 if FEATURE.changing and FEATURE.verlet else step
        add_2d(count, i * columns + column, closing, parameters, integers, close_x, close_y)


@routine
def apply_pins(i, column, blocks, source, here, source_plane, target, there, target_plane, sheet):
    """Put the pinned masses of row `i` at their positions in `source`, at rest."""
    for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
        j = sheet.pin_column[k] - column
        if j >= 0 and j < blocks * BLOCK:
            for axis in range(2):
                target[there + axis * target_plane + j] = source[here + axis * source_plane + j]
                target[there + (2 + axis) * target_plane + j] = 0.0


@row_routine
def ghosts_of(x, y, last_x, last_y, spare):
    """Set the last `spare` columns of a block to the position of the mass before them."""
    for j in range(BLOCK):
        x[j] = last_x if j >= BLOCK - spare else x[j]
        y[j] = last_y if j >= BLOCK - spare else y[j]


@routine
def place_ghosts(column, blocks, layout, target, there, target_plane):
    """Set the ghosts to the row's last mass, if the written part ends at the grid's edge."""
    first = layout[L_COLUMNS] - column
    if FEATURE.springs and first <= blocks * BLOCK:
        spare = BLOCK - first % BLOCK
        start = there + first + spare - BLOCK
        last_x, last_y = row_at(target, there + first - 1)[0], row_at(target, there + target_plane + first - 1)[0]
        ghosts_of(row_at(target, start), row_at(target, start + target_plane), last_x, last_y, spare)
