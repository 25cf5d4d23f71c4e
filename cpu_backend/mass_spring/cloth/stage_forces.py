"""Forces of a cloth that depend on neighbours, mass by mass: the stages `spring forces` and `wind`.

A neighbour beyond the edge is the mass itself: coincident masses do not pull, and a triangle with all corners at one
position has no area for the wind.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.mass_spring.cloth.wind import make_air, make_triangle
from softlab.model.formulas import springs
from softlab.model.mass_spring.cloth_parameters import spring_constants
from softlab.model.scene.cloth import SPRING_KINDS


def make_pull(compiler: Compiler, real: Any, kind: str, has_damper: bool) -> Any:
    """Make pull(state, i, j, row, column, parameters): the acceleration of mass (i, j) by its spring to (row,
    column)."""
    formulas = springs.make_3d(real, compiler.compiled)
    spring_acceleration_3d, damped_pull_3d = formulas.spring_acceleration_3d, formulas.damped_pull_3d
    k_stiffness, k_rest, k_damping = spring_constants(kind)

    @compiler.compiled
    def pull(state, i, j, row, column, parameters):
        x, y, z, vx, vy, vz = state
        dx, dy, dz = x[row, column] - x[i, j], y[row, column] - y[i, j], z[row, column] - z[i, j]
        if has_damper:
            wx, wy, wz = vx[row, column] - vx[i, j], vy[row, column] - vy[i, j], vz[row, column] - vz[i, j]
            return damped_pull_3d(
                dx, dy, dz, wx, wy, wz, parameters[k_stiffness], parameters[k_rest], parameters[k_damping]
            )  # fmt: skip
        return spring_acceleration_3d(dx, dy, dz, parameters[k_stiffness], parameters[k_rest])

    return pull


def make_spring_stage(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """Compile spring_forces(state, parameters, acceleration).

    `state` (x, y, z, vx, vy, vz), `acceleration` (ax, ay, az), each an array (rows, columns). A kind's four springs in
    pairs, then (structural + shear) + bending.
    """
    structural, shear, bending = (make_pull(compiler, real, k, f"{k}-damping" in parts) for k in SPRING_KINDS)
    has_structural, has_shear, has_bending = (kind in parts for kind in SPRING_KINDS)
    compiled, zero = compiler.compiled, real(0)

    @compiled
    def pairs(a, b, c, d):
        return (a[0] + b[0]) + (c[0] + d[0]), (a[1] + b[1]) + (c[1] + d[1]), (a[2] + b[2]) + (c[2] + d[2])

    @compiled
    def structural_sum(state, i, j, rows, columns, parameters):
        return pairs(
            structural(state, i, j, i, min(j + 1, columns - 1), parameters),
            structural(state, i, j, i, max(j - 1, 0), parameters),
            structural(state, i, j, min(i + 1, rows - 1), j, parameters),
            structural(state, i, j, max(i - 1, 0), j, parameters),
        )

    @compiled
    def beside(i, j, down, right, rows, columns):
        """Return (row, column) of a neighbour; beyond the edge the mass itself."""
        row, column = i + down, j + right
        if row < 0 or row >= rows or column < 0 or column >= columns:
            return i, j
        return row, column

    @compiled
    def shear_sum(state, i, j, rows, columns, parameters):
        a, b = beside(i, j, 1, 1, rows, columns), beside(i, j, -1, -1, rows, columns)
        c, d = beside(i, j, 1, -1, rows, columns), beside(i, j, -1, 1, rows, columns)
        return pairs(
            shear(state, i, j, a[0], a[1], parameters), shear(state, i, j, b[0], b[1], parameters),
            shear(state, i, j, c[0], c[1], parameters), shear(state, i, j, d[0], d[1], parameters),
        )  # fmt: skip

    @compiled
    def bending_sum(state, i, j, rows, columns, parameters):
        a, b = beside(i, j, 0, 2, rows, columns), beside(i, j, 0, -2, rows, columns)
        c, d = beside(i, j, 2, 0, rows, columns), beside(i, j, -2, 0, rows, columns)
        return pairs(
            bending(state, i, j, a[0], a[1], parameters), bending(state, i, j, b[0], b[1], parameters),
            bending(state, i, j, c[0], c[1], parameters), bending(state, i, j, d[0], d[1], parameters),
        )  # fmt: skip

    def spring_forces(state, record, acceleration):
        ax, ay, az = acceleration
        rows, columns = ax.shape
        for row in prange(rows):
            i = np.int64(row)
            for j in range(columns):
                fx, fy, fz = zero, zero, zero
                if has_structural:
                    fx, fy, fz = structural_sum(state, i, j, rows, columns, record[0])
                if has_shear:
                    hx, hy, hz = shear_sum(state, i, j, rows, columns, record[0])
                    if has_structural:
                        hx, hy, hz = fx + hx, fy + hy, fz + hz
                    fx, fy, fz = hx, hy, hz
                if has_bending:
                    bx, by, bz = bending_sum(state, i, j, rows, columns, record[0])
                    if has_structural or has_shear:
                        bx, by, bz = fx + bx, fy + by, fz + bz
                    fx, fy, fz = bx, by, bz
                ax[i, j] = fx
                ay[i, j] = fy
                az[i, j] = fz

    return compiler.kernel(spring_forces)


def make_wind_stage(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """Compile wind(state, parameters, integers, step, offset, acceleration): the six triangles of each mass."""
    triangle, air_now = make_triangle(compiler, real), make_air(compiler, real, parts)
    compiled = compiler.compiled

    @compiled
    def corner(state, i, j, rows, columns, own_row, own_column):
        """Return (position, velocity) of mass (i, j), or beyond the edge of the mass (own_row, own_column)."""
        x, y, z, vx, vy, vz = state
        if i < 0 or i >= rows or j < 0 or j >= columns:
            i, j = own_row, own_column
        return (x[i, j], y[i, j], z[i, j]), (vx[i, j], vy[i, j], vz[i, j])

    @compiled
    def cell(state, i, j, upper, rows, columns, own_row, own_column, air, parameters):
        """Return the wind on each corner of a triangle of cell (i, j): the upper one (A, D, B) or the lower one (A, C,
        D)."""
        if i < 0 or i >= rows - 1 or j < 0 or j >= columns - 1:
            a, va = corner(state, own_row, own_column, rows, columns, own_row, own_column)
            return triangle(a, a, a, va, va, va, air, parameters.drag, parameters.lift)
        a, va = corner(state, i, j, rows, columns, own_row, own_column)
        d, vd = corner(state, i + 1, j + 1, rows, columns, own_row, own_column)
        if upper:
            b, vb = corner(state, i, j + 1, rows, columns, own_row, own_column)
            return triangle(a, d, b, va, vd, vb, air, parameters.drag, parameters.lift)
        c, vc = corner(state, i + 1, j, rows, columns, own_row, own_column)
        return triangle(a, c, d, va, vc, vd, air, parameters.drag, parameters.lift)

    @compiled
    def plus(a, b):
        return a[0] + b[0], a[1] + b[1], a[2] + b[2]

    def wind(state, record, integers, step, offset, acceleration):
        ax, ay, az = acceleration
        rows, columns = ax.shape
        air = air_now(record[0], integers, step, offset)
        for row in prange(rows):
            i = np.int64(row)
            for j in range(columns):
                own = plus(
                    cell(state, i, j, False, rows, columns, i, j, air, record[0]),
                    cell(state, i, j, True, rows, columns, i, j, air, record[0]),
                )
                beside = plus(
                    cell(state, i, j - 1, True, rows, columns, i, j, air, record[0]),
                    cell(state, i - 1, j, False, rows, columns, i, j, air, record[0]),
                )
                opposite = plus(
                    cell(state, i - 1, j - 1, False, rows, columns, i, j, air, record[0]),
                    cell(state, i - 1, j - 1, True, rows, columns, i, j, air, record[0]),
                )
                push_x, push_y, push_z = plus(plus(own, beside), opposite)
                ax[i, j] += push_x
                ay[i, j] += push_y
                az[i, j] += push_z

    return compiler.kernel(wind)
