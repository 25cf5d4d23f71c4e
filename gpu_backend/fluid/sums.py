"""What a fluid's particle sums up over its list, on CUDA, as device functions: one thread a particle, in the list's order.

A position is a quad whose fourth number is the particle's fluid, or, from a substep's first `density` on, the change of its
multiplier, so that `correct` finds all it wants to know of a neighbour in one load.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from gpu_backend.core.compile import inlined
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad
from gpu_backend.fluid.lists import make_ways
from model.fluid.parameters import F_WEIGHT, FLUID_FIELDS
from model.formulas.fluid import density


class List(NamedTuple):
    """Of one particle: the s-th of its `count` neighbours lies in place k + s * particles of `table`."""

    table: Any
    count: Any
    particles: Any


@cache
def make_row(parts: frozenset[str]) -> Any:
    """row(fluid) -> where the row of a fluid, a quad's fourth number, begins; 0 where all are alike."""
    several, fields = "fluids" in parts, np.int32(FLUID_FIELDS)

    def row(fluid):
        if several:
            return np.int32(np.int32(fluid) * fields)
        return np.int32(0)

    return inlined("exact")(row)


@cache
def make_sums(real: Any, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """`pair(k, p, j, q, parameters)` -> (dx, dy, dz, squared) of two that must not lie in one place; of particle k at p:
    `sum_factor(k, p, position, list, wall, fluids, parameters)`; `sum_density(k, p, position, list, parameters)`;
    `sum_correction(k, p, position, list, wall, parameters)` -> (x, y, z). `wall`: (density, gx, gy, gz) of `make_walls`."""
    formulas, inline, way = device_formulas(density.make, real, math), inlined(math), make_ways(real, math, repeats)
    squared, apart, near, slope = formulas.squared, formulas.apart, formulas.near, formulas.slope
    gradient_added, own_added, factor = formulas.gradient_added, formulas.own_added, formulas.factor
    density_added, crowded, correction_added = formulas.density_added, formulas.crowded, formulas.correction_added
    wall_added, row = formulas.wall_added, make_row(parts)
    is_tensile, has_walls, zero, weight_field = "tensile" in parts, "walls" in parts, real(0), np.int32(F_WEIGHT)

    @inline
    def pair(k, p, j, q, parameters):
        dx, dy, dz = way(p, q, parameters)
        dy = apart(dy, squared(dx, dy, dz), parameters.support, k < j)
        return dx, dy, dz, squared(dx, dy, dz)

    @inline
    def sum_factor(k, p, position, near_by, wall, fluids, parameters):
        gx, gy, gz, own, at = zero, zero, zero, zero, np.int64(k)
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            q = load_quad(position, j)
            dx, dy, dz, r = pair(k, p, j, q, parameters)
            s = slope(r, parameters.inverse_support, parameters.gradient_scale)
            gx, gy, gz = gradient_added(gx, s, dx), gradient_added(gy, s, dy), gradient_added(gz, s, dz)
            own = own_added(own, fluids[row(q[3]) + weight_field], s, r)
        weight = fluids[row(p[3]) + weight_field]
        return factor(parameters.relaxation, weight, gx, gy, gz, own, wall[1], wall[2], wall[3], parameters.softness)

    @inline
    def sum_density(k, p, position, near_by, parameters):
        total, at = zero, np.int64(k)
        for _ in range(near_by.count):
            q = load_quad(position, near_by.table[at])
            at += near_by.particles
            dx, dy, dz = way(p, q, parameters)
            total = density_added(total, near(squared(dx, dy, dz), parameters.inverse_support))
        return total

    @inline
    def sum_correction(k, p, position, near_by, wall, parameters):
        x, y, z, at = zero, zero, zero, np.int64(k)
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            q = load_quad(position, j)
            dx, dy, dz, r = pair(k, p, j, q, parameters)
            s, both = slope(r, parameters.inverse_support, parameters.gradient_scale), p[3] + q[3]
            if is_tensile:
                t = near(r, parameters.inverse_support)
                both = both - crowded(t, parameters.inverse_tensile, parameters.tensile)
            x = correction_added(x, both, s, dx)
            y, z = correction_added(y, both, s, dy), correction_added(z, both, s, dz)
        if has_walls:
            x, y, z = wall_added(x, p[3], wall[1]), wall_added(y, p[3], wall[2]), wall_added(z, p[3], wall[3])
        return x, y, z

    return SimpleNamespace(pair=pair, sum_factor=sum_factor, sum_density=sum_density, sum_correction=sum_correction)
