"""Wind on a cloth's triangles, for the CPU's kernels: each triangle once; its corners add it up.

A cell (i, j) has the corners A (i, j), B (i, j + 1), C (i + 1, j), D (i + 1, j + 1) and two triangles, (A, C, D) and
(A, D, B). The force on all corners is equal, so a triangle's force is stored with its cell; 0 for cells outside the
sheet.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, block_of, row_at
from softlab.cpu_backend.core.scratch import AXES, SPAN
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, random, wind


def make_air(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make air_now(parameters, integers, step, offset): the air's velocity (x, y, z) [m/s], `offset` steps into the
    step."""
    compiled = compiler.compiled
    formulas, gusty = compiler.formulas(wind, real), compiler.formulas(cloth, real).gusty
    stage_time, gust_interval, gust = formulas.stage_time, formulas.gust_interval, formulas.gust
    philox, stream = compiler.formulas(random, real).philox, np.uint64(wind.GUST_STREAM)
    has_gust = "gust" in parts

    @compiled
    def air_now(parameters, integers, step, offset):
        x, y, z = parameters.wind_x, parameters.wind_y, parameters.wind_z
        if has_gust:
            time = stage_time(step, offset, parameters.dt, parameters.first_step, parameters.first_time)
            interval, passed = gust_interval(time, parameters.gust_time)
            before, _, _, _ = philox(integers[2], np.uint64(interval), stream)
            after, _, _, _ = philox(integers[2], np.uint64(interval + 1), stream)
            g, most = gust(before, after, passed), parameters.gust
            x, y, z = gusty(x, most, g), gusty(y, most, g), gusty(z, most, g)
        return x, y, z

    return air_now


def make_triangle(compiler: Compiler, real: Real) -> Callable:
    """Make triangle(a, b, c, velocities of a, b and c, air, parameters): the wind acceleration [m/s^2] of each corner,
    three numbers each, one after the other."""
    triangle_wind = compiler.formulas(wind, real).triangle_wind
    mean = compiler.formulas(cloth, real).mean

    @compiler.compiled
    def triangle(a, b, c, va, vb, vc, air, drag, lift):
        return triangle_wind(
            (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
            (air[0] - mean(va[0], vb[0], vc[0]), air[1] - mean(va[1], vb[1], vc[1]), air[2] - mean(va[2], vb[2], vc[2])),
            drag, lift,
        )  # fmt: skip

    return triangle


def make_winds(
    compiler: Compiler,
    real: Real,
    parts: frozenset[str],
    place: Any,
    edge: Callable,
    forget: Callable,
    clear: Callable,
    at: dict[str, int],
) -> SimpleNamespace:
    """Make `air_now`, `wind_cells` and `add_wind`.

    `wind_cells(i, ...)`: the forces of the triangles between rows `i` and i + 1, into scratch; `add_wind(i, blocks,
    scratch, width)`: the six forces on each mass of row `i`, added to `close`.
    """
    block, compiled = block_of(real), compiler.compiled
    triangle = make_triangle(compiler, real)
    a_first, a_second, a_close = at.get("first", 0), at.get("second", 0), at["close"]

    @compiler.row
    def cell_row(
        blocks, x, y, z, vx, vy, vz, x_below, y_below, z_below, vx_below, vy_below, vz_below, air, drag, lift, first_x,
        first_y, first_z, second_x, second_y, second_z,
    ):  # fmt: skip
        for j in range(blocks * block):
            a, va = (x[j], y[j], z[j]), (vx[j], vy[j], vz[j])
            b, vb = (x[j + 1], y[j + 1], z[j + 1]), (vx[j + 1], vy[j + 1], vz[j + 1])
            c, vc = (x_below[j], y_below[j], z_below[j]), (vx_below[j], vy_below[j], vz_below[j])
            d = x_below[j + 1], y_below[j + 1], z_below[j + 1]
            vd = vx_below[j + 1], vy_below[j + 1], vz_below[j + 1]
            px, py, pz = triangle(a, c, d, va, vc, vd, air, drag, lift)
            qx, qy, qz = triangle(a, d, b, va, vd, vb, air, drag, lift)
            first_x[j] = px
            first_y[j] = py
            first_z[j] = pz
            second_x[j] = qx
            second_y[j] = qy
            second_z[j] = qz

    @compiled
    def wind_cells(i, blocks, layout, source, parameters, air, scratch, width):
        rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
        here, below = i * stride, (i + 1) * stride
        first, second = a_first + i % 2, a_second + i % 2
        if i + 1 < rows:
            cell_row(
                blocks, row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane),
                row_at(source, here + 3 * plane), row_at(source, here + 4 * plane), row_at(source, here + 5 * plane),
                row_at(source, below), row_at(source, below + plane), row_at(source, below + 2 * plane),
                row_at(source, below + 3 * plane), row_at(source, below + 4 * plane), row_at(source, below + 5 * plane),
                air, parameters.drag, parameters.lift, row_at(scratch, place(first, 0, width)),
                row_at(scratch, place(first, 1, width)), row_at(scratch, place(first, 2, width)),
                row_at(scratch, place(second, 0, width)), row_at(scratch, place(second, 1, width)),
                row_at(scratch, place(second, 2, width)),
            )  # fmt: skip
            forget(scratch, first, columns - 1, width)
            forget(scratch, second, columns - 1, width)
        else:
            clear(scratch, first, width)
            clear(scratch, second, width)

    @compiler.row
    def add_row(blocks, first, second, first_above, second_above, out):
        for k in range(SPAN, blocks * block + SPAN):
            central, beside = first[k] + second[k], second[k - 1] + first_above[k]
            opposite = first_above[k - 1] + second_above[k - 1]
            out[k - SPAN] = out[k - SPAN] + ((central + beside) + opposite)

    @compiled
    def add_wind(i, blocks, scratch, width):
        now, above = i % 2, (i + 1) % 2
        for axis in range(AXES):
            add_row(
                blocks, row_at(scratch, edge(a_first + now, axis, width)), row_at(scratch, edge(a_second + now, axis, width)),
                row_at(scratch, edge(a_first + above, axis, width)), row_at(scratch, edge(a_second + above, axis, width)),
                row_at(scratch, place(a_close, axis, width)),
            )  # fmt: skip

    return SimpleNamespace(air_now=make_air(compiler, real, parts), wind_cells=wind_cells, add_wind=add_wind)


def make_wind_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile wind(state, parameters, integers, step, offset, acceleration): the six triangles of each mass."""
    triangle, air_now = make_triangle(compiler, real), make_air(compiler, real, parts)
    compiled = compiler.compiled

    @compiled
    def corner(state, i, j, rows, columns, edge_row, edge_column):
        """Return (position, velocity) of mass (i, j), or beyond the edge of the mass (own_row, own_column)."""
        x, y, z, vx, vy, vz = state
        if i < 0 or i >= rows or j < 0 or j >= columns:
            i, j = edge_row, edge_column
        return (x[i, j], y[i, j], z[i, j]), (vx[i, j], vy[i, j], vz[i, j])

    @compiled
    def cell(state, i, j, upper, rows, columns, edge_row, edge_column, air, parameters):
        """Return the wind on each corner of a triangle of cell (i, j): the upper one (A, D, B) or the lower one (A, C,
        D)."""
        if i < 0 or i >= rows - 1 or j < 0 or j >= columns - 1:
            a, va = corner(state, edge_row, edge_column, rows, columns, edge_row, edge_column)
            return triangle(a, a, a, va, va, va, air, parameters.drag, parameters.lift)
        a, va = corner(state, i, j, rows, columns, edge_row, edge_column)
        d, vd = corner(state, i + 1, j + 1, rows, columns, edge_row, edge_column)
        if upper:
            b, vb = corner(state, i, j + 1, rows, columns, edge_row, edge_column)
            return triangle(a, d, b, va, vd, vb, air, parameters.drag, parameters.lift)
        c, vc = corner(state, i + 1, j, rows, columns, edge_row, edge_column)
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
                central = plus(
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
                push_x, push_y, push_z = plus(plus(central, beside), opposite)
                ax[i, j] += push_x
                ay[i, j] += push_y
                az[i, j] += push_z

    return compiler.kernel(wind)
