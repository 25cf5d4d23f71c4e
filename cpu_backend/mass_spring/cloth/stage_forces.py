"""Forces of a cloth that depend on neighbours, mass by mass: the stages `spring forces` and `wind`.

A neighbour beyond the edge is the mass itself: coincident masses do not pull, and a triangle with all corners at one
position has no area for the wind.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.mass_spring.cloth.rows import has_damper, k_damping, k_rest, k_stiffness, pulls_of
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, features_of, filled, routine
from softlab.model.formulas.springs import damped_pull_3d, spring_acceleration_3d
from softlab.model.tables.cloth import SPRING_KINDS

structural, shear, bending = (
    Open(f"{kind}(state, i, j, row, column, parameters): `pull` of a kind of springs") for kind in SPRING_KINDS
)


@routine
def pull(state, i, j, row, column, parameters):
    """Return the acceleration of mass (i, j) by its spring to (row, column)."""
    x, y, z, vx, vy, vz = state
    dx, dy, dz = x[row, column] - x[i, j], y[row, column] - y[i, j], z[row, column] - z[i, j]
    if has_damper:
        wx, wy, wz = vx[row, column] - vx[i, j], vy[row, column] - vy[i, j], vz[row, column] - vz[i, j]
        return damped_pull_3d(
            dx, dy, dz, wx, wy, wz, parameters[k_stiffness], parameters[k_rest], parameters[k_damping]
        )  # fmt: skip
    return spring_acceleration_3d(dx, dy, dz, parameters[k_stiffness], parameters[k_rest])


@routine
def pairs(a, b, c, d):
    return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])


@routine
def structural_sum(state, i, j, rows, columns, parameters):
    return pairs(
        structural(state, i, j, i, min(j + 1, columns - 1), parameters),
        structural(state, i, j, i, max(j - 1, 0), parameters),
        structural(state, i, j, min(i + 1, rows - 1), j, parameters),
        structural(state, i, j, max(i - 1, 0), j, parameters),
    )


@routine
def beside(i, j, down, right, rows, columns):
    """Return (row, column) of a neighbour; beyond the edge the mass itself."""
    row, column = i + down, j + right
    if row < 0 or row >= rows or column < 0 or column >= columns:
        return i, j
    return row, column


@routine
def shear_sum(state, i, j, rows, columns, parameters):
    a, b = beside(i, j, 1, 1, rows, columns), beside(i, j, -1, -1, rows, columns)
    c, d = beside(i, j, 1, -1, rows, columns), beside(i, j, -1, 1, rows, columns)
    return pairs(
        shear(state, i, j, a[0], a[1], parameters), shear(state, i, j, b[0], b[1], parameters),
        shear(state, i, j, c[0], c[1], parameters), shear(state, i, j, d[0], d[1], parameters),
    )  # fmt: skip


@routine
def bending_sum(state, i, j, rows, columns, parameters):
    a, b = beside(i, j, 0, 2, rows, columns), beside(i, j, 0, -2, rows, columns)
    c, d = beside(i, j, 2, 0, rows, columns), beside(i, j, -2, 0, rows, columns)
    return pairs(
        bending(state, i, j, a[0], a[1], parameters), bending(state, i, j, b[0], b[1], parameters),
        bending(state, i, j, c[0], c[1], parameters), bending(state, i, j, d[0], d[1], parameters),
    )  # fmt: skip


@routine
def spring_forces(state, record, acceleration):
    """Sum up the pulls of all springs on each mass.

    `state` (x, y, z, vx, vy, vz), `acceleration` (ax, ay, az), each an array (rows, columns). A kind's four springs in
    pairs, then (structural + shear) + bending.
    """
    ax, ay, az = acceleration
    rows, columns = ax.shape
    for row in prange(rows):
        i = np.int64(row)
        for j in range(columns):
            fx, fy, fz = 0.0, 0.0, 0.0
            if FEATURE.structural:
                fx, fy, fz = structural_sum(state, i, j, rows, columns, record[0])
            if FEATURE.shear:
                hx, hy, hz = shear_sum(state, i, j, rows, columns, record[0])
                if FEATURE.structural:
                    hx, hy, hz = fx + hx, fy + hy, fz + hz
                fx, fy, fz = hx, hy, hz
            if FEATURE.bending:
                bx, by, bz = bending_sum(state, i, j, rows, columns, record[0])
                if FEATURE.structural or FEATURE.shear:
                    bx, by, bz = fx + bx, fy + by, fz + bz
                fx, fy, fz = bx, by, bz
            ax[i, j] = fx
            ay[i, j] = fy
            az[i, j] = fz


def make_spring_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile `spring_forces`."""
    variant = compiler.variant_of(real, features_of(parts))
    return compiler.kernel(variant.copied(filled(spring_forces, pulls_of(parts, pull))))
