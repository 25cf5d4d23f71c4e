"""The wind on one mass of a sheet, as device functions, and the air's velocity, which is the same for all masses."""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.integers import WIND_SEED
from softlab.gpu_backend.core.quads import load_quad
from softlab.model.base.variant import FEATURE, inlined_routine, real
from softlab.model.formulas.cloth import gusty, mean
from softlab.model.formulas.random import philox
from softlab.model.formulas.wind import GUST_STREAM, gust, gust_interval, stage_time, triangle_wind


@inlined_routine
def air_now(parameters, integers, step, offset):
    """Return the air's velocity (x, y, z) [m/s], `offset` steps into the step."""
    x, y, z = parameters.wind_x, parameters.wind_y, parameters.wind_z
    if FEATURE.gust:
        time = stage_time(step, offset, parameters.dt, parameters.first_step, parameters.first_time)
        interval, part = gust_interval(time, parameters.gust_time)
        before, _, _, _ = philox(integers[WIND_SEED], np.uint64(interval), np.uint64(GUST_STREAM))
        after, _, _, _ = philox(integers[WIND_SEED], np.uint64(interval + np.int64(1)), np.uint64(GUST_STREAM))
        g, largest = gust(before, after, part), parameters.gust
        x, y, z = gusty(x, largest, g), gusty(y, largest, g), gusty(z, largest, g)
    return x, y, z


@inlined_routine
def wind_on_corner(a, b, c, parameters, air):
    """Return the wind on each corner of the triangle a, b, c, each (x, y, z, vx, vy, vz)."""
    return triangle_wind(
        (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
        (air[0] - mean(a[3], b[3], c[3]), air[1] - mean(a[4], b[4], c[4]), air[2] - mean(a[5], b[5], c[5])),
        parameters.drag, parameters.lift,
    )  # fmt: skip


@inlined_routine
def wind_of(p, neighbours, parameters, air):
    """Return the wind on the mass p from (right, below, left, above, below_right, near_left, near_above, above_left);
    each is (x, y, z, vx, vy, vz).

    For a cell outside the sheet one corner, which both edges share, is the mass itself: two corners then coincide,
    an edge is 0, and so is the normal, in any rounding. So the neighbour to the left and the one above occur twice:
    for the cells below and right, and for the others.
    """
    right, below, left, above, below_right, near_left, near_above, above_left = neighbours
    a, b = (
        wind_on_corner(p, below, below_right, parameters, air),
        wind_on_corner(p, below_right, right, parameters, air),
    )
    x, y, z = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    a, b = wind_on_corner(left, below, p, parameters, air), wind_on_corner(above, p, right, parameters, air)
    x, y, z = x + (a[0] + b[0]), y + (a[1] + b[1]), z + (a[2] + b[2])
    a = wind_on_corner(above_left, near_left, p, parameters, air)
    b = wind_on_corner(above_left, p, near_above, parameters, air)
    return x + (a[0] + b[0]), y + (a[1] + b[1]), z + (a[2] + b[2])


@inlined_routine
def state_at(position, velocity, place):
    p, v = load_quad(position, place), load_quad(velocity, place)
    return p[0], p[1], p[2], v[0], v[1], v[2]


@inlined_routine
def wind_sum(position, velocity, place, cell, p, v, parameters, air):
    """Return the wind over mass [m/s^2] on the mass at a place, with the position p and the velocity v."""
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
    right = state_at(position, velocity, place if last else place + np.int32(1))
    below = state_at(position, velocity, place if bottom else place + columns)
    left = state_at(position, velocity, place if first or bottom else place - np.int32(1))
    above = state_at(position, velocity, place if top or last else place - columns)
    below_right = state_at(position, velocity, place if bottom or last else place + columns + np.int32(1))
    near_left = state_at(position, velocity, place if first else place - np.int32(1))
    near_above = state_at(position, velocity, place if top else place - columns)
    above_left = state_at(position, velocity, place if top or first else place - columns - np.int32(1))
    here = (p[0], p[1], p[2], v[0], v[1], v[2])
    neighbours = (right, below, left, above, below_right, near_left, near_above, above_left)
    return wind_of(here, neighbours, parameters, air)


@inlined_routine
def block_air(parameters, integers, step, offset):
    """Return the air's velocity (x, y, z) [m/s]; every thread of the block must call it."""
    if FEATURE.gust:
        shared = cuda.shared.array(3, real)
        if cuda.threadIdx.x == 0 and cuda.threadIdx.y == 0:
            shared[0], shared[1], shared[2] = air_now(parameters, integers, step, offset)
        cuda.syncthreads()
        return shared[0], shared[1], shared[2]
    if FEATURE.wind:
        return air_now(parameters, integers, step, offset)
    return 0.0, 0.0, 0.0
