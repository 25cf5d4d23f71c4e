"""One time step of one row, common to the kernels `fused`, `team` and `tiled`, so that they cannot differ.

If a scene has only equal springs, gravity and damping, forces and integration are one loop that reads and writes every
number once. With other parts (random, poke) and with alternating springs, accelerations are first summed
in rows of scratch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.layout import BLOCK, row_at
from softlab.cpu_backend.mass_spring.grid.rows import (
    CLOSE_X,
    CLOSE_Y,
    OPEN_X,
    OPEN_Y,
    add_later_parts,
    apply_pins,
    place_ghosts,
    pull_from_left,
    sum_accelerations,
    sum_row,
    with_gravity,
)
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, routine, row_routine
from softlab.model.formulas.integrators import one_force, verlet_first_half, verlet_second_half
from softlab.model.formulas.springs import damped, spring_acceleration_2d

OPENING, MIDDLE, CLOSING = 0, 1, 2  # passes of velocity Verlet; one-force integrators use MIDDLE only
finish = Open("finish(p, v, closing, opening, parameters) -> (p', v') of one axis of a mass, in a pass")


class Walk(NamedTuple):
    """Pulls passed down a walk, two rows of `width`, and rows of scratch for sums."""

    above: np.ndarray
    sums: np.ndarray
    width: int


@routine
def pass_kind(k, passes):
    """Return the kind of pass `k` of Passes."""
    kind = MIDDLE
    if k == passes.number - 1:
        kind = passes.last
    if k == 0:
        kind = passes.first
    return kind


@routine
def opening_kick(position, velocity, closing, opening, parameters):
    return verlet_first_half(position, velocity, opening, parameters.dt, parameters.half_dt, parameters.damping)


@routine
def middle_step(position, velocity, closing, opening, parameters):
    if FEATURE.verlet:
        whole = verlet_second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)
        return verlet_first_half(position, whole, opening, parameters.dt, parameters.half_dt, parameters.damping)
    if FEATURE.damped:
        closing = damped(closing, velocity, parameters.damping)
    return one_force(position, velocity, closing, parameters.dt, parameters.half_dt_squared)


@routine
def closing_kick(position, velocity, closing, opening, parameters):
    return position, verlet_second_half(velocity, closing, parameters.half_dt, parameters.inverse_damping)


@row_routine
def whole_row(
    blocks, x, y, vx, vy, x_below, y_below, left_x, left_y, above_x, above_y, parameters, new_x, new_y, new_vx, new_vy
):  # fmt: skip
    stiffness, stiffness_rest = parameters.stiffness, parameters.stiffness_rest
    for j in range(blocks * BLOCK):
        ax, ay = 0.0, 0.0
        if FEATURE.springs:
            right_x, right_y = spring_acceleration_2d(x[j + 1] - x[j], y[j + 1] - y[j], stiffness, stiffness_rest)
            below_x, below_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, stiffness_rest)
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


opening_row = filled(whole_row, {"finish": opening_kick})
middle_row = filled(whole_row, {"finish": middle_step})
closing_row = filled(whole_row, {"finish": closing_kick})


@inlined_routine
def in_one_loop(kind, step, i, column, blocks, old, new, left, walk, sheet):
    x, y, vx, vy, x_below, y_below = old
    new_x, new_y, new_vx, new_vy = new
    above_x, above_y, parameters = row_at(walk.above, 0), row_at(walk.above, walk.width), sheet.parameters
    if FEATURE.verlet and kind == OPENING:
        opening_row(
            blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
            new_vy,
        )  # fmt: skip
    elif FEATURE.verlet and kind == CLOSING:
        closing_row(
            blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
            new_vy,
        )  # fmt: skip
    else:
        middle_row(
            blocks, x, y, vx, vy, x_below, y_below, left[0], left[1], above_x, above_y, parameters, new_x, new_y, new_vx,
            new_vy,
        )  # fmt: skip


@row_routine
def finish_row(blocks, position, velocity, closing, opening, parameters, new_position, new_velocity):
    for j in range(blocks * BLOCK):
        p, v = finish(position[j], velocity[j], closing[j], opening[j], parameters)
        new_position[j] = p
        new_velocity[j] = v


finish_opening = filled(finish_row, {"finish": opening_kick})
finish_middle = filled(finish_row, {"finish": middle_step})
finish_closing = filled(finish_row, {"finish": closing_kick})


@routine
def finish_axis(kind, blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity):
    """Integrate one axis of a row from its sums of accelerations."""
    if FEATURE.verlet and kind == OPENING:
        finish_opening(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)
    elif FEATURE.verlet and kind == CLOSING:
        finish_closing(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)
    else:
        finish_middle(blocks, position, velocity, closing_sum, opening_sum, parameters, new_position, new_velocity)


@inlined_routine
def through_sums(kind, step, i, column, blocks, old, new, left, walk, sheet):
    above, sums, width = walk
    parameters = sheet.parameters
    x, y, vx, vy, x_below, y_below = old
    new_x, new_y, new_vx, new_vy = new
    close_x, close_y = row_at(sums, CLOSE_X * width), row_at(sums, CLOSE_Y * width)
    open_x, open_y = close_x, close_y
    if FEATURE.changing and FEATURE.verlet:
        open_x, open_y = row_at(sums, OPEN_X * width), row_at(sums, OPEN_Y * width)
    above_x, above_y = row_at(above, 0), row_at(above, width)
    sum_row(i, blocks, x, y, x_below, y_below, left[0], left[1], above_x, above_y, parameters, close_x, close_y)
    add_later_parts(i, column, blocks, sheet.layout, parameters, sheet.integers, step, sums, width)
    finish_axis(kind, blocks, x, vx, close_x, open_x, parameters, new_x, new_vx)
    finish_axis(kind, blocks, y, vy, close_y, open_y, parameters, new_y, new_vy)


@inlined_routine
def step_row(
    kind, step, i, column, blocks, source, here, below, source_plane, target, there, target_plane, above, sums, width,
    sheet,
):  # fmt: skip
    """Advance row `i` of the grid, `blocks` blocks from `column` on, by one pass. `here` and `below`:
    offsets of that part of the row, and of the row below it, in the flat array `source`, whose planes are
    `source_plane` apart; it is written to `target` from `there` on. For the grid's last row `below` is `here`. `above`:
    the pulls passed down the walk, two rows of `width`. `sums`: scratch of SUM_ROWS such rows.
    """
    left = pull_from_left(source, here, source_plane, column, sheet.parameters)
    old = (
        row_at(source, here), row_at(source, here + source_plane), row_at(source, here + 2 * source_plane),
        row_at(source, here + 3 * source_plane), row_at(source, below), row_at(source, below + source_plane),
    )  # fmt: skip
    new = (
        row_at(target, there), row_at(target, there + target_plane), row_at(target, there + 2 * target_plane),
        row_at(target, there + 3 * target_plane),
    )  # fmt: skip
    if FEATURE.forced or FEATURE.alternating:
        through_sums(kind, step, i, column, blocks, old, new, left, Walk(above, sums, width), sheet)
    else:
        in_one_loop(kind, step, i, column, blocks, old, new, left, Walk(above, sums, width), sheet)
    if FEATURE.pins and sheet.pin_start[i] < sheet.pin_start[i + 1]:
        apply_pins(i, column, blocks, source, here, source_plane, target, there, target_plane, sheet)
    place_ghosts(column, blocks, sheet.layout, target, there, target_plane)
