"""One time step of one row, common to the kernels `fused`, `team` and `tiled`, so that they cannot differ.

If a scene has only equal springs, gravity and damping, forces and integration are one loop that reads and writes every
number once. With other parts (random, poke) and with alternating springs, accelerations are first summed
in rows of scratch.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.mass_spring.grid.rows import CLOSE_X, CLOSE_Y, OPEN_X, OPEN_Y, make_row_forces
from softlab.model.base.types import Real
from softlab.model.core.integrators import step_formula
from softlab.model.formulas import integrators

OPENING, MIDDLE, CLOSING = 0, 1, 2  # passes of velocity Verlet; one-force integrators use MIDDLE only


class Walk(NamedTuple):
    """Pulls passed down a walk, two rows of `width`, and rows of scratch for sums."""

    above: np.ndarray
    sums: np.ndarray
    width: int


def pass_kind(k, passes):
    """Return the kind of pass `k` of Passes; kernels compile it."""
    kind = MIDDLE
    if k == passes.number - 1:
        kind = passes.last
    if k == 0:
        kind = passes.first
    return kind


def make_finishes(
    compiler: Compiler, real: Real, integrator: str, has_damping: bool, damped: Callable
) -> dict[str, Callable]:
    """Make, by a pass's name, finish(p, v, closing, opening, parameters) -> (p', v') of one axis of a mass."""
    compiled = compiler.compiled
    formulas = compiler.formulas(integrators, real, {"damped": has_damping})
    if integrator != "velocity-verlet":
        one_force = formulas.variant(step_formula(integrator))

        @compiled
        def step(position, velocity, closing, opening, parameters):
            if has_damping:
                closing = damped(closing, velocity, parameters.damping)
            return one_force(position, velocity, closing, parameters.dt, parameters.half_dt_squared)

        return {"middle": step}

    first_half, second_half = formulas.verlet_first_half, formulas.verlet_second_half

    @compiled
    def opening_kick(position, velocity, closing, opening, parameters):
        return first_half(position, velocity, opening, parameters.dt, parameters.half_dt, parameters.damping)

    @compiled
    def both_kicks(position, velocity, closing, opening, parameters):
        whole = second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)
        return first_half(position, whole, opening, parameters.dt, parameters.half_dt, parameters.damping)

    @compiled
    def closing_kick(position, velocity, closing, opening, parameters):
        return position, second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)

    return {"opening": opening_kick, "middle": both_kicks, "closing": closing_kick}


def make_row_step(compiler: Compiler, real: Real, integrator: str, parts: frozenset[str]) -> tuple[Callable, Callable]:
    """Make (begin_walk, step_row) of a variant; begin_walk: see mass_spring/grid/rows.py.

    step_row(kind, step, i, column, blocks, source, here, below, source_plane, target, there, target_plane, above, sums,
    width, sheet) advances row `i` of the grid, `blocks` blocks from `column` on, by one pass. `here` and `below`:
    offsets of that part of the row, and of the row below it, in the flat array `source`, whose planes are
    `source_plane` apart; it is written to `target` from `there` on. For the grid's last row `below` is `here`. `above`:
    the pulls passed down the walk, two rows of `width`. `sums`: scratch of SUM_ROWS such rows.
    """
    forces = make_row_forces(compiler, real, integrator, parts)
    finishes = make_finishes(compiler, real, integrator, "damping" in parts, forces.damped)
    through_sums = forces.later_parts or forces.alternating
    advance_row = (_make_row_through_sums if through_sums else _make_row_in_one_loop)(compiler, forces, real, finishes)
    has_pins = "pins" in parts
    apply_pins, place_ghosts, pull_from_left = forces.apply_pins, forces.place_ghosts, forces.pull_from_left

    @compiler.inlined
    def step_row(
        kind, step, i, column, blocks, source, here, below, source_plane, target, there, target_plane, above, sums, width,
        sheet,
    ):  # fmt: skip
        left = pull_from_left(source, here, source_plane, column, sheet.parameters)
        old = (
            row_at(source, here), row_at(source, here + source_plane), row_at(source, here + 2 * source_plane),
            row_at(source, here + 3 * source_plane), row_at(source, below), row_at(source, below + source_plane),
        )  # fmt: skip
        new = (
            row_at(target, there), row_at(target, there + target_plane), row_at(target, there + 2 * target_plane),
            row_at(target, there + 3 * target_plane),
        )  # fmt: skip
        advance_row(kind, step, i, column, blocks, old, new, left, Walk(above, sums, width), sheet)
        if has_pins and sheet.pin_start[i] < sheet.pin_start[i + 1]:
            apply_pins(i, column, blocks, source, here, source_plane, target, there, target_plane, sheet)
        place_ghosts(column, blocks, sheet.layout, target, there, target_plane)

    return forces.begin_walk, step_row


def _make_row_in_one_loop(
    compiler: Compiler, forces: SimpleNamespace, real: Real, finishes: dict[str, Callable]
) -> Callable:
    block, zero, has_springs, verlet = forces.block, real(0), forces.has_springs, len(finishes) > 1
    spring_acceleration_2d, sum_accelerations, with_gravity = (
        forces.spring_acceleration_2d,
        forces.sum_accelerations,
        forces.with_gravity,
    )

    def make_loop(name: str) -> Callable:
        finish = finishes.get(name, finishes["middle"])

        def whole_row(
            blocks, x, y, vx, vy, x_below, y_below, left_x, left_y, above_x, above_y, parameters, new_x, new_y, new_vx, new_vy
        ):  # fmt: skip
            stiffness, stiffness_rest = parameters.stiffness, parameters.stiffness_rest
            for j in range(blocks * block):
                ax, ay = zero, zero
                if has_springs:
                    right_x, right_y = spring_acceleration_2d(
                        x[j + 1] - x[j], y[j + 1] - y[j], stiffness, stiffness_rest
                    )
                    below_x, below_y = spring_acceleration_2d(
                        x_below[j] - x[j], y_below[j] - y[j], stiffness, stiffness_rest
                    )
                    ax = sum_accelerations(right_x, left_x, below_x, above_x[j])
                    ay = sum_accelerations(right_y, left_y, below_y, above_y[j])
                    left_x, left_y = right_x, right_y
                    above_x[j] = below_x
                    above_y[j] = below_y
                ay = with_gravity(ay, parameters)
                px, qx = finish(x[j], vx[j], ax, ax, parameters)
                py, qy = finish(y[j], vy[j], ay, ay, parameters)
                new_x[j] = px
                new_y[j] = py
                new_vx[j] = qx
                new_vy[j] = qy

        whole_row.__name__ = f"{name}_whole_row"
        return compiler.row(whole_row)

    opening, middle, closing = make_loop("opening"), make_loop("middle"), make_loop("closing")

    @compiler.inlined
    def in_one_loop(kind, step, i, column, blocks, old, new, left, walk, sheet):
        x, y, vx, vy, x_below, y_below = old
        new_x, new_y, new_vx, new_vy = new
        above_x, above_y, parameters = row_at(walk.above, 0), row_at(walk.above, walk.width), sheet.parameters
        if verlet and kind == OPENING:
            opening(
                blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
                new_vy,
            )  # fmt: skip
        elif verlet and kind == CLOSING:
            closing(
                blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
                new_vy,
            )  # fmt: skip
        else:
            middle(
                blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
                new_vy,
            )  # fmt: skip

    return in_one_loop


def make_finish_axis(compiler: Compiler, real: Real, finishes: dict[str, Callable]) -> Callable:
    """Make finish_axis(kind, blocks, position, velocity, closing, opening, parameters, new_position, new_velocity): it
    integrates one axis of a row from its sums of accelerations by `finishes` (of `make_finishes`)."""
    block, verlet = block_of(real), len(finishes) > 1

    def make_loop(name: str) -> Callable:
        finish = finishes.get(name, finishes["middle"])

        def finish_row(blocks, position, velocity, closing, opening, parameters, new_position, new_velocity):
            for j in range(blocks * block):
                p, v = finish(position[j], velocity[j], closing[j], opening[j], parameters)
                new_position[j] = p
                new_velocity[j] = v

        finish_row.__name__ = f"{name}_finish_row"
        return compiler.row(finish_row)

    opening, middle, closing = make_loop("opening"), make_loop("middle"), make_loop("closing")

    @compiler.compiled
    def finish_axis(kind, blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity):
        if verlet and kind == OPENING:
            opening(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)
        elif verlet and kind == CLOSING:
            closing(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)
        else:
            middle(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)

    return finish_axis


def _make_row_through_sums(
    compiler: Compiler, forces: SimpleNamespace, real: Real, finishes: dict[str, Callable]
) -> Callable:
    two_sums = forces.two_sums
    sum_row, add_later_parts = forces.sum_row, forces.add_later_parts
    alternating, sum_uneven_row = forces.alternating, forces.sum_uneven_row

    finish_axis = make_finish_axis(compiler, real, finishes)

    @compiler.inlined
    def through_sums(kind, step, i, column, blocks, old, new, left, walk, sheet):
        above, sums, width = walk
        parameters = sheet.parameters
        x, y, vx, vy, x_below, y_below = old
        new_x, new_y, new_vx, new_vy = new
        close_x, close_y = row_at(sums, CLOSE_X * width), row_at(sums, CLOSE_Y * width)
        open_x, open_y = close_x, close_y
        if two_sums:
            open_x, open_y = row_at(sums, OPEN_X * width), row_at(sums, OPEN_Y * width)
        above_x, above_y = row_at(above, 0), row_at(above, width)
        if alternating:
            sum_uneven_row(
                i, blocks, x, y, x_below, y_below, left[0], left[1], above_x, above_y, parameters, close_x, close_y
            )  # fmt: skip
        else:
            sum_row(blocks, x, y, x_below, y_below, left[0], left[1], above_x, above_y, parameters, close_x, close_y)
        add_later_parts(i, column, blocks, sheet.layout, parameters, sheet.integers, step, sums, width)
        finish_axis(kind, blocks, x, vx, close_x, open_x, parameters, new_x, new_vx)
        finish_axis(kind, blocks, y, vy, close_y, open_y, parameters, new_y, new_vy)

    return through_sums
