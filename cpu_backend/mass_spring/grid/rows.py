"""Accelerations of a row of masses, for all kernels but `stages`: each spring once, vectorised along the row.

core/layout.py defines the storage. A walk goes down the rows: the pull along a row is passed from mass to mass, the
pull of the row below is passed to the next row, where it is minus the pull up. Sums have one fixed order, (right +
left) + (below + above), then gravity, external, poke, damping. Flags are closure constants: a part that a
scene lacks leaves no code.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, block_of, row_at
from softlab.cpu_backend.core.own_forces import make_particle_force_row
from softlab.cpu_backend.mass_spring.grid.alternating import make_alternating_rows
from softlab.model.base.types import Real
from softlab.model.core.own_forces import particle_forces, particle_forces_change
from softlab.model.formulas import springs

# rows of accelerations of a band: two sums for the step, and two for the step before (velocity Verlet)
CLOSE_X, CLOSE_Y, OPEN_X, OPEN_Y = range(4)
SUM_ROWS = 4


def variant_name(kernel: str, real: Real, math: str, integrator: str, parts: frozenset[str]) -> str:
    """Return a unique name of a kernel's variant, valid as a symbol."""
    words = [kernel, np.dtype(real).name, math, integrator.replace("-", "_"), *sorted(parts)]
    return "_".join(words)


def make_row_springs(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make springs and gravity of a row: `pull_from_left`, `sum_row` and `begin_walk` (see the inner functions), and
    their components; `sum_uneven_row`: `sum_row` for alternating springs."""
    compiled, block, zero = compiler.compiled, block_of(real), real(0)
    formulas = compiler.formulas(springs, real)
    spring_acceleration_2d, damped = formulas.spring_acceleration_2d, formulas.damped
    has_springs, has_gravity, alternating = "springs" in parts, "gravity" in parts, "alternating" in parts

    @compiled
    def sum_accelerations(right, left, below, above):
        return (right - left) + (below - above)

    @compiled
    def with_gravity(acceleration, parameters):
        if has_gravity:
            return acceleration + parameters.gravity
        return acceleration

    uneven = make_alternating_rows(compiler, real, spring_acceleration_2d, sum_accelerations, with_gravity)
    spring_constants, uneven_pull_from_below = uneven.spring_constants, uneven.pull_from_below

    @compiler.row
    def pull_from_below(blocks, x, y, x_below, y_below, parameters, out_x, out_y):
        """Write the spring forces on a row's masses from the row below. The row below gets the same forces with the
        opposite sign."""
        stiffness, stiffness_rest = parameters.stiffness, parameters.stiffness_rest
        for j in range(blocks * block):
            pull_x, pull_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, stiffness_rest)
            out_x[j] = pull_x
            out_y[j] = pull_y

    @compiled
    def pull_from_left(source, here, plane, column, parameters):
        """Return the pull between the first mass of a part of a row and the one left of it: (0, 0) at the grid's
        edge."""
        if alternating and column > 0:
            stiffness, rest = spring_constants(column - 1, parameters)
            return spring_acceleration_2d(
                source[here] - source[here - 1], source[here + plane] - source[here + plane - 1], stiffness, rest
            )  # fmt: skip
        if has_springs and column > 0:
            return spring_acceleration_2d(
                source[here] - source[here - 1], source[here + plane] - source[here + plane - 1], parameters.stiffness,
                parameters.stiffness_rest,
            )  # fmt: skip
        return zero, zero

    @compiler.row
    def sum_row(blocks, x, y, x_below, y_below, left_x, left_y, above_x, above_y, parameters, close_x, close_y):
        """Sum springs and gravity of a row into `close`.

        At entry `above` has the pulls between this row and the one above, at exit those between it and the one below.
        The last row is its own row below, which does not pull.
        """
        stiffness, stiffness_rest = parameters.stiffness, parameters.stiffness_rest
        for j in range(blocks * block):
            ax, ay = zero, zero
            if has_springs:
                right_x, right_y = spring_acceleration_2d(x[j + 1] - x[j], y[j + 1] - y[j], stiffness, stiffness_rest)
                below_x, below_y = spring_acceleration_2d(
                    x_below[j] - x[j], y_below[j] - y[j], stiffness, stiffness_rest
                )
                ax = sum_accelerations(right_x, left_x, below_x, above_x[j])
                ay = sum_accelerations(right_y, left_y, below_y, above_y[j])
                left_x, left_y = right_x, right_y
                above_x[j] = below_x
                above_y[j] = below_y
            close_x[j] = ax
            close_y[j] = with_gravity(ay, parameters)

    @compiled
    def begin_walk(i, blocks, source, here, stride, plane, parameters, above, width):
        """Compute the pulls between row `i`, where a walk begins, and the row above it; `here`: offset of row i."""
        if has_springs:
            above_x, above_y = row_at(above, 0), row_at(above, width)
            if i > 0:
                up = here - stride
                both = (
                    row_at(source, up), row_at(source, up + plane), row_at(source, here), row_at(source, here + plane),
                )  # fmt: skip
                if alternating:
                    uneven_pull_from_below(i - 1, blocks, *both, parameters, above_x, above_y)
                else:
                    pull_from_below(blocks, *both, parameters, above_x, above_y)
            else:
                for j in range(blocks * block):
                    above_x[j] = zero
                    above_y[j] = zero

    return SimpleNamespace(
        has_springs=has_springs, has_gravity=has_gravity, alternating=alternating, damped=damped,
        spring_acceleration_2d=spring_acceleration_2d, sum_accelerations=sum_accelerations, with_gravity=with_gravity,
        pull_from_left=pull_from_left, sum_row=sum_row, sum_uneven_row=uneven.sum_row, begin_walk=begin_walk,
    )  # fmt: skip


def make_later_parts(compiler: Compiler, real: Real, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `add_later_parts` (see the inner function), for the own forces, which are added after springs and gravity,
    row by row.

    `later_parts`: true if there are any. `two_sums`: true if velocity Verlet's two kicks need separate accelerations,
    since their random forces belong to different steps.
    """
    compiled, block = compiler.compiled, block_of(real)
    has_particle_forces = bool(particle_forces(parts))
    two_sums = particle_forces_change(parts) and integrator == "velocity-verlet"
    add_particle_force = make_particle_force_row(compiler, real, 2, parts)

    @compiled
    def add_later_parts(i, column, blocks, layout, parameters, integers, step, sums, width):
        """Add the forces on single particles to the sums of row `i` from `column` on."""
        columns = layout[L_COLUMNS]
        count = min(blocks * block, columns - column)
        close_x, close_y = row_at(sums, CLOSE_X * width), row_at(sums, CLOSE_Y * width)
        open_x, open_y = row_at(sums, OPEN_X * width), row_at(sums, OPEN_Y * width)
        if two_sums:
            for j in range(count):
                open_x[j] = close_x[j]
                open_y[j] = close_y[j]
            add_particle_force(count, i * columns + column, step, parameters, integers, open_x, open_y)
        if has_particle_forces:
            closing = step - 1 if two_sums else step
            add_particle_force(count, i * columns + column, closing, parameters, integers, close_x, close_y)

    return SimpleNamespace(two_sums=two_sums, later_parts=has_particle_forces, add_later_parts=add_later_parts)


def make_row_edges(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `apply_pins` and `place_ghosts`, which complete a written row (see the inner functions)."""
    compiled, block, zero, has_springs = compiler.compiled, block_of(real), real(0), "springs" in parts

    @compiled
    def apply_pins(i, column, blocks, source, here, source_plane, target, there, target_plane, sheet):
        """Put pinned masses of row `i` where `source` has them, at rest."""
        for k in range(sheet.pin_start[i], sheet.pin_start[i + 1]):
            j = sheet.pin_column[k] - column
            if j >= 0 and j < blocks * block:
                for axis in range(2):
                    target[there + axis * target_plane + j] = source[here + axis * source_plane + j]
                    target[there + (2 + axis) * target_plane + j] = zero

    @compiler.row
    def ghosts_of(x, y, last_x, last_y, spare):
        """Set the last `spare` columns of a block to the position of the mass before them."""
        for j in range(block):
            x[j] = last_x if j >= block - spare else x[j]
            y[j] = last_y if j >= block - spare else y[j]

    @compiled
    def place_ghosts(column, blocks, layout, target, there, target_plane):
        """Set the ghosts to the row's last mass, if the written part ends at the grid's edge."""
        first = layout[L_COLUMNS] - column
        if has_springs and first <= blocks * block:
            spare = block - first % block
            start = there + first + spare - block
            last_x, last_y = row_at(target, there + first - 1)[0], row_at(target, there + target_plane + first - 1)[0]
            ghosts_of(row_at(target, start), row_at(target, start + target_plane), last_x, last_y, spare)

    return SimpleNamespace(apply_pins=apply_pins, place_ghosts=place_ghosts)


def make_row_forces(compiler: Compiler, real: Real, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the functions of the makers above for a variant's kernels, and flags of its parts."""
    return SimpleNamespace(
        block=block_of(real), has_pins="pins" in parts, has_damping="damping" in parts,
        **vars(make_row_springs(compiler, real, parts)), **vars(make_later_parts(compiler, real, integrator, parts)),
        **vars(make_row_edges(compiler, real, parts)),
    )  # fmt: skip
