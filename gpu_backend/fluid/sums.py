"""Sums of a fluid's particle over its neighbour list, on CUDA, as device functions: one thread per particle, in the
list's order.

A position is a quad whose fourth number is the particle's fluid, or, from the first `density` of a substep on, the
change of its multiplier, so that `correct` reads all about a neighbour in one load.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.lists import offset
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, open_constant
from softlab.model.fluid.parameters import F_WEIGHT, FLUID_FIELDS
from softlab.model.formulas.fluid.density import (
    apart,
    closeness,
    correction_added,
    crowded,
    density_added,
    factor,
    gradient_added,
    near,
    slope,
    squared,
    squares_added,
    wall_added,
)

begun = open_constant("the sums without any neighbour")
added = Open("added(sums, k, p, j, q, fluids, parameters): the sums with neighbour j at q")


class List(NamedTuple):
    """The list of one particle: neighbour s of `count` is at index k + s * particles of `table`."""

    table: DeviceArray
    count: Any  # as a number it would hide the tuple's method
    particles: np.int32


class Weights(NamedTuple):
    """Rows of fluids, and the weight of the first one, which applies to all if they are alike."""

    rows: DeviceArray
    weight: float


@inlined_routine
def row(fluid):
    """Return the offset of the row of a fluid, a quad's fourth number; 0 if all are alike."""
    if FEATURE.fluids:
        return np.int32(np.int32(fluid) * FLUID_FIELDS)
    return np.int32(0)


@inlined_routine
def entry(table, k, row, last, particles):
    """Return an entry of row `row` of the list, or of its last one."""
    return table[np.uint64(k) + np.uint64(np.uint32(min(row, last))) * np.uint64(particles)]


@inlined_routine
def over_list(k, p, position, near_by, fluids, parameters):
    """Add each neighbour of particle k at p to `begun`, in the list's order.

    Four neighbours at a time: their four loads, and the next four indices, are in flight before the first is needed.
    """
    sums, count, table, particles = begun, near_by.count, near_by.table, np.uint32(near_by.particles)
    if count > 0:
        last, k_ = np.int32(count - 1), np.uint32(k)
        a, b = entry(table, k_, np.int32(0), last, particles), entry(table, k_, np.int32(1), last, particles)
        c, d = entry(table, k_, np.int32(2), last, particles), entry(table, k_, np.int32(3), last, particles)
        row = np.int32(4)  # of the entries after a, b, c, d
        while row <= count:
            q, r = load_quad(position, a), load_quad(position, b)
            t, u = load_quad(position, c), load_quad(position, d)
            e, f = entry(table, k_, row, last, particles), entry(table, k_, np.int32(row + 1), last, particles)
            g = entry(table, k_, np.int32(row + 2), last, particles)
            h = entry(table, k_, np.int32(row + 3), last, particles)
            sums = added(sums, k, p, a, q, fluids, parameters)
            sums = added(sums, k, p, b, r, fluids, parameters)
            sums = added(sums, k, p, c, t, fluids, parameters)
            sums = added(sums, k, p, d, u, fluids, parameters)
            a, b, c, d, row = e, f, g, h, np.int32(row + 4)
        left = np.int32(count & 3)
        q, r, t = load_quad(position, a), load_quad(position, b), load_quad(position, c)
        if left > 0:
            sums = added(sums, k, p, a, q, fluids, parameters)
        if left > 1:
            sums = added(sums, k, p, b, r, fluids, parameters)
        if left > 2:
            sums = added(sums, k, p, c, t, fluids, parameters)
    return sums


@inlined_routine
def pair(k, p, j, q, parameters):
    """Return (dx, dy, dz, squared) of two particles, separated if they coincide."""
    dx, dy, dz = offset(p, q, parameters)
    dy = apart(dy, squared(dx, dy, dz), parameters.support, k < j)
    return dx, dy, dz, squared(dx, dy, dz)


@inlined_routine
def factor_added(sums, k, p, j, q, fluids, parameters):
    gx, gy, gz, squares = sums
    dx, dy, dz, r = pair(k, p, j, q, parameters)
    s = slope(r, parameters.inverse_support, parameters.gradient_scale)
    gx, gy, gz = gradient_added(gx, s, dx), gradient_added(gy, s, dy), gradient_added(gz, s, dz)
    weight = fluids.rows[row(q[3]) + F_WEIGHT] if FEATURE.fluids else fluids.weight
    return gx, gy, gz, squares_added(squares, weight, s, r)


@inlined_routine
def total_added(total, k, p, j, q, fluids, parameters):
    dx, dy, dz = offset(p, q, parameters)
    return density_added(total, closeness(squared(dx, dy, dz), parameters.inverse_support))


@inlined_routine
def pushes_added(sums, k, p, j, q, fluids, parameters):
    """Add a neighbour to a correction."""
    x, y, z = sums
    dx, dy, dz, r = pair(k, p, j, q, parameters)
    s, both = slope(r, parameters.inverse_support, parameters.gradient_scale), p[3] + q[3]
    if FEATURE.tensile:
        both = both - crowded(near(r, parameters.inverse_support), parameters.inverse_tensile, parameters.tensile)
    return correction_added(x, both, s, dx), correction_added(y, both, s, dy), correction_added(z, both, s, dz)


over_factors = filled(over_list, {"added": factor_added, "begun": (0.0, 0.0, 0.0, 0.0)})
over_totals = filled(over_list, {"added": total_added, "begun": 0.0})
over_pushes = filled(over_list, {"added": pushes_added, "begun": (0.0, 0.0, 0.0)})


@inlined_routine
def both_added(sums, k, p, j, position, fluids, parameters):
    """Add a neighbour by `factor_added` and, to the last sum, by `total_added`, as visited by a search. `fluids`: of
    `weights_of`."""
    gx, gy, gz, squares, total = sums
    q = load_quad(position, j)
    gx, gy, gz, squares = factor_added((gx, gy, gz, squares), k, p, j, q, fluids, parameters)
    return gx, gy, gz, squares, total_added(total, k, p, j, q, fluids, parameters)


@inlined_routine
def weights_of(fluids):
    return Weights(fluids, fluids[F_WEIGHT])


@inlined_routine
def factor_of(p, sums, wall, fluids, parameters):
    """Return the factor of a particle at p by the sums of its list and `wall`: (density, gx, gy, gz)."""
    weight = fluids[row(p[3]) + F_WEIGHT]
    return factor(
        parameters.relaxation, weight, sums[0], sums[1], sums[2], sums[3], wall[1], wall[2], wall[3],
        parameters.softness,
    )  # fmt: skip


@inlined_routine
def sum_factor(k, p, position, near_by, wall, fluids, parameters):
    sums = over_factors(k, p, position, near_by, weights_of(fluids), parameters)
    return factor_of(p, sums, wall, fluids, parameters)


@inlined_routine
def sum_density(k, p, position, near_by, parameters):
    return over_totals(k, p, position, near_by, None, parameters)


@inlined_routine
def sum_correction(k, p, position, near_by, wall, parameters):
    """Return (x, y, z), the sum of the pushes of neighbours and walls."""
    x, y, z = over_pushes(k, p, position, near_by, None, parameters)
    if FEATURE.walls:
        x, y, z = wall_added(x, p[3], wall[1]), wall_added(y, p[3], wall[2]), wall_added(z, p[3], wall[3])
    return x, y, z
