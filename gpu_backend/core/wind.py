"""The wind on one mass of a sheet, as device functions, and the air's velocity, which is the same for all masses."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas, device_variant
from softlab.gpu_backend.core.integers import WIND_SEED
from softlab.gpu_backend.core.quads import load_quad
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, random, wind


@cache
def make_wind(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make `air_now(parameters, integers, step, offset)`, the air's velocity (x, y, z) [m/s], and `wind_sum(position,
    velocity, place, cell, p, v, parameters, air)`, the wind over mass [m/s^2] on one mass."""
    formulas, sums = device_formulas(wind, real, math), device_formulas(cloth, real, math)
    triangle_wind, gust_interval, gust_of = formulas.triangle_wind, formulas.gust_interval, formulas.gust
    stage_time, mean, gusty = formulas.stage_time, sums.mean, sums.gusty
    inline = inlined(math)
    philox = device_variant(real, math, inline=True)(random.philox)
    has_gust = "gust" in parts
    one, next_one, stream = np.int32(1), np.int64(1), np.uint64(wind.GUST_STREAM)

    @inline
    def air_now(parameters, integers, step, offset):
        x, y, z = parameters.wind_x, parameters.wind_y, parameters.wind_z
        if has_gust:
            time = stage_time(step, offset, parameters.dt, parameters.first_step, parameters.first_time)
            interval, part = gust_interval(time, parameters.gust_time)
            before, _, _, _ = philox(integers[WIND_SEED], np.uint64(interval), stream)
            after, _, _, _ = philox(integers[WIND_SEED], np.uint64(interval + next_one), stream)
            g, gust = gust_of(before, after, part), parameters.gust
            x, y, z = gusty(x, gust, g), gusty(y, gust, g), gusty(z, gust, g)
        return x, y, z

    @inline
    def corner(a, b, c, parameters, air):
        """Return the wind on each corner of the triangle a, b, c, each (x, y, z, vx, vy, vz)."""
        return triangle_wind(
            (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
            (air[0] - mean(a[3], b[3], c[3]), air[1] - mean(a[4], b[4], c[4]), air[2] - mean(a[5], b[5], c[5])),
            parameters.drag, parameters.lift,
        )  # fmt: skip

    @inline
    def wind_of(p, neighbours, parameters, air):
        """Return the wind on the mass p from (right, below, left, above, below_right, near_left, near_above,
        above_left); each is (x, y, z, vx, vy, vz).

        For a cell outside the sheet one corner, which both edges share, is the mass itself: two corners then coincide,
        an edge is 0, and so is the normal, in any rounding. So the neighbour to the left and the one above occur twice:
        for the cells below and right, and for the others.
        """
        right, below, left, above, below_right, near_left, near_above, above_left = neighbours
        a, b = corner(p, below, below_right, parameters, air), corner(p, below_right, right, parameters, air)
        x, y, z = a[0] + b[0], a[1] + b[1], a[2] + b[2]
        a, b = corner(left, below, p, parameters, air), corner(above, p, right, parameters, air)
        x, y, z = x + (a[0] + b[0]), y + (a[1] + b[1]), z + (a[2] + b[2])
        a, b = corner(above_left, near_left, p, parameters, air), corner(above_left, p, near_above, parameters, air)
        return x + (a[0] + b[0]), y + (a[1] + b[1]), z + (a[2] + b[2])

    @inline
    def state_at(position, velocity, place):
        p, v = load_quad(position, place), load_quad(velocity, place)
        return p[0], p[1], p[2], v[0], v[1], v[2]

    @inline
    def wind_sum(position, velocity, place, cell, p, v, parameters, air):
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        right = state_at(position, velocity, place if last else place + one)
        below = state_at(position, velocity, place if bottom else place + columns)
        left = state_at(position, velocity, place if first or bottom else place - one)
        above = state_at(position, velocity, place if top or last else place - columns)
        below_right = state_at(position, velocity, place if bottom or last else place + columns + one)
        near_left = state_at(position, velocity, place if first else place - one)
        near_above = state_at(position, velocity, place if top else place - columns)
        above_left = state_at(position, velocity, place if top or first else place - columns - one)
        here = (p[0], p[1], p[2], v[0], v[1], v[2])
        neighbours = (right, below, left, above, below_right, near_left, near_above, above_left)
        return wind_of(here, neighbours, parameters, air)

    return SimpleNamespace(air_now=air_now, wind_sum=wind_sum, wind_of=wind_of)


@cache
def make_block_air(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make air(parameters, integers, step, offset) -> (x, y, z) [m/s]; every thread of the block must call it."""
    air_now = make_wind(real, math, parts).air_now
    has_wind, has_gust = "wind" in parts, "gust" in parts
    zero = real(0)

    @inlined(math)
    def block_air(parameters, integers, step, offset):
        if has_gust:
            shared = cuda.shared.array(3, real)
            if cuda.threadIdx.x == 0 and cuda.threadIdx.y == 0:
                shared[0], shared[1], shared[2] = air_now(parameters, integers, step, offset)
            cuda.syncthreads()
            return shared[0], shared[1], shared[2]
        if has_wind:
            return air_now(parameters, integers, step, offset)
        return zero, zero, zero

    return block_air
