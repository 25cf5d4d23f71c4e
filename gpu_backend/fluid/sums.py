"""Sums of a fluid's particle over its neighbour list, on CUDA, as device functions: one thread per particle, in the
list's order.

A position is a quad whose fourth number is the particle's fluid, or, from the first `density` of a substep on, the
change of its multiplier, so that `correct` reads all about a neighbour in one load.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.fluid.lists import make_offset
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_WEIGHT, FLUID_FIELDS
from softlab.model.formulas.fluid import density


class List(NamedTuple):
    """The list of one particle: neighbour s of `count` is at index k + s * particles of `table`."""

    table: DeviceArray
    count: Any  # as a number it would hide the tuple's method
    particles: np.int32


class Weights(NamedTuple):
    """Rows of fluids, and the weight of the first one, which applies to all if they are alike."""

    rows: DeviceArray
    weight: float


@cache
def make_row(parts: frozenset[str]) -> Callable:
    """Make row(fluid): the offset of the row of a fluid, a quad's fourth number; 0 if all are alike."""
    several, fields = "fluids" in parts, np.int32(FLUID_FIELDS)

    def row(fluid):
        if several:
            return np.int32(np.int32(fluid) * fields)
        return np.int32(0)

    return inlined("exact")(row)


def make_over_list(math: str, added: Callable, begun: float | tuple[float, ...]) -> Callable:
    """Make over_list(k, p, position, near_by, fluids, parameters): it adds each neighbour of particle k at p to
    `begun`.

    added(sums, k, p, j, q, fluids, parameters) adds neighbour j at q. Four neighbours at a time: their four loads, and
    the next four indices, are in flight before the first is needed; `added` is called in the list's order.
    """
    one, two, three, four = np.int32(1), np.int32(2), np.int32(3), np.int32(4)

    @inlined("exact")
    def entry(table, k, row, last, particles):
        """Return an entry of row `row` of the list, or of its last one."""
        return table[np.uint64(k) + np.uint64(np.uint32(min(row, last))) * np.uint64(particles)]

    @inlined(math)
    def over_list(k, p, position, near_by, fluids, parameters):
        sums, count, table, particles = begun, near_by.count, near_by.table, np.uint32(near_by.particles)
        if count > 0:
            last, k_ = np.int32(count - one), np.uint32(k)
            a, b = entry(table, k_, np.int32(0), last, particles), entry(table, k_, one, last, particles)
            c, d = entry(table, k_, two, last, particles), entry(table, k_, three, last, particles)
            row = four  # of the entries after a, b, c, d
            while row <= count:
                q, r = load_quad(position, a), load_quad(position, b)
                t, u = load_quad(position, c), load_quad(position, d)
                e, f = entry(table, k_, row, last, particles), entry(table, k_, np.int32(row + one), last, particles)
                g = entry(table, k_, np.int32(row + two), last, particles)
                h = entry(table, k_, np.int32(row + three), last, particles)
                sums = added(sums, k, p, a, q, fluids, parameters)
                sums = added(sums, k, p, b, r, fluids, parameters)
                sums = added(sums, k, p, c, t, fluids, parameters)
                sums = added(sums, k, p, d, u, fluids, parameters)
                a, b, c, d, row = e, f, g, h, np.int32(row + four)
            left = np.int32(count & three)
            q, r, t = load_quad(position, a), load_quad(position, b), load_quad(position, c)
            if left > 0:
                sums = added(sums, k, p, a, q, fluids, parameters)
            if left > one:
                sums = added(sums, k, p, b, r, fluids, parameters)
            if left > two:
                sums = added(sums, k, p, c, t, fluids, parameters)
        return sums

    return over_list


@cache
def make_pair(real: Real, math: str, repeats: frozenset[str]) -> Callable:
    """Make pair(k, p, j, q, parameters) -> (dx, dy, dz, squared) of two particles, separated if they coincide."""
    formulas, inline, offset = (
        device_formulas(density, real, math),
        inlined(math),
        make_offset(real, math, repeats),
    )
    squared, apart = formulas.squared, formulas.apart

    @inline
    def pair(k, p, j, q, parameters):
        dx, dy, dz = offset(p, q, parameters)
        dy = apart(dy, squared(dx, dy, dz), parameters.support, k < j)
        return dx, dy, dz, squared(dx, dy, dz)

    return pair


def _make_added(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Make functions that add neighbour j at q to sums of particle k at p, for `make_over_list`."""
    f, inline, offset, row = (
        device_formulas(density, real, math),
        inlined(math),
        make_offset(real, math, repeats),
        make_row(parts),
    )
    squared, near, closeness, slope, pair = f.squared, f.near, f.closeness, f.slope, make_pair(real, math, repeats)
    gradient_added, squares_added, density_added, crowded = (
        f.gradient_added,
        f.squares_added,
        f.density_added,
        f.crowded,
    )
    correction_added, weight_field = f.correction_added, np.int32(F_WEIGHT)
    is_tensile, several = "tensile" in parts, "fluids" in parts

    @inline
    def factor_added(sums, k, p, j, q, fluids, parameters):
        gx, gy, gz, squares = sums
        dx, dy, dz, r = pair(k, p, j, q, parameters)
        s = slope(r, parameters.inverse_support, parameters.gradient_scale)
        gx, gy, gz = gradient_added(gx, s, dx), gradient_added(gy, s, dy), gradient_added(gz, s, dz)
        weight = fluids.rows[row(q[3]) + weight_field] if several else fluids.weight
        return gx, gy, gz, squares_added(squares, weight, s, r)

    @inline
    def total_added(total, k, p, j, q, fluids, parameters):
        dx, dy, dz = offset(p, q, parameters)
        return density_added(total, closeness(squared(dx, dy, dz), parameters.inverse_support))

    @inline
    def correction_and_more(sums, k, p, j, q, fluids, parameters):
        x, y, z = sums
        dx, dy, dz, r = pair(k, p, j, q, parameters)
        s, both = slope(r, parameters.inverse_support, parameters.gradient_scale), p[3] + q[3]
        if is_tensile:
            both = both - crowded(near(r, parameters.inverse_support), parameters.inverse_tensile, parameters.tensile)
        return correction_added(x, both, s, dx), correction_added(y, both, s, dy), correction_added(z, both, s, dz)

    return SimpleNamespace(
        factor_added=factor_added, total_added=total_added, correction_and_more=correction_and_more
    )  # fmt: skip


@cache
def make_sums(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Make the sums of particle k at p over its list.

    `sum_factor(k, p, position, list, wall, fluids, parameters)`; `sum_density(k, p, position, list, parameters)`;
    `sum_correction(k, p, position, list, wall, parameters)` -> (x, y, z). `wall`: (density, gx, gy, gz) of
    `make_walls`. For a search: `both_added` with `weights_of(fluids)`, whose last sum is the density's, and
    `factor_of(p, sums, wall, fluids, parameters)` of the other sums.
    """
    formulas, inline, added = (
        device_formulas(density, real, math),
        inlined(math),
        _make_added(real, math, parts, repeats),
    )
    factor, wall_added, row, zero = formulas.factor, formulas.wall_added, make_row(parts), real(0)
    factor_added, total_added = added.factor_added, added.total_added
    has_walls, weight_field = "walls" in parts, np.int32(F_WEIGHT)

    @inline
    def both_added(sums, k, p, j, position, fluids, parameters):
        """Add a neighbour by `factor_added` and `total_added`, as visited by a search."""
        gx, gy, gz, squares, total = sums
        q = load_quad(position, j)
        gx, gy, gz, squares = factor_added((gx, gy, gz, squares), k, p, j, q, fluids, parameters)
        return gx, gy, gz, squares, total_added(total, k, p, j, q, fluids, parameters)

    over_factors = make_over_list(math, factor_added, (zero, zero, zero, zero))
    over_totals = make_over_list(math, total_added, zero)
    over_corrections = make_over_list(math, added.correction_and_more, (zero, zero, zero))

    @inline
    def weights_of(fluids):
        return Weights(fluids, fluids[weight_field])

    @inline
    def factor_of(p, sums, wall, fluids, parameters):
        weight = fluids[row(p[3]) + weight_field]
        return factor(
            parameters.relaxation, weight, sums[0], sums[1], sums[2], sums[3], wall[1], wall[2], wall[3],
            parameters.softness,
        )  # fmt: skip

    @inline
    def sum_factor(k, p, position, near_by, wall, fluids, parameters):
        sums = over_factors(k, p, position, near_by, weights_of(fluids), parameters)
        return factor_of(p, sums, wall, fluids, parameters)

    @inline
    def sum_density(k, p, position, near_by, parameters):
        return over_totals(k, p, position, near_by, None, parameters)

    @inline
    def sum_correction(k, p, position, near_by, wall, parameters):
        x, y, z = over_corrections(k, p, position, near_by, None, parameters)
        if has_walls:
            x, y, z = wall_added(x, p[3], wall[1]), wall_added(y, p[3], wall[2]), wall_added(z, p[3], wall[3])
        return x, y, z

    return SimpleNamespace(
        weights_of=weights_of, factor_of=factor_of, both_added=both_added, sum_factor=sum_factor, sum_density=sum_density,
        sum_correction=sum_correction,
    )  # fmt: skip
