"""Wind on a cloth's triangles, for the CPU's kernels: each triangle once; its corners add it up.

A cell (i, j) has the corners A (i, j), B (i, j + 1), C (i + 1, j), D (i + 1, j + 1) and two triangles, (A, C, D) and
(A, D, B). The force on all corners is equal, so a triangle's force is stored with its cell; 0 for cells outside the
sheet.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, row_at
from softlab.cpu_backend.core.normals import plus
from softlab.cpu_backend.core.scratch import AXES, SPAN, clear_column, clear_triple, row_edge, row_start
from softlab.model.base.types import Feature, Real
from softlab.model.base.variant import FEATURE, features_of, routine, row_routine
from softlab.model.formulas.cloth import gusty
from softlab.model.formulas.random import philox
from softlab.model.formulas.wind import GUST_STREAM, gust, gust_interval, stage_time, wind_on_triangle


@routine
def air_now(parameters, integers, step, offset):
    """Return the air's velocity (x, y, z) [m/s], `offset` steps into the step."""
    x, y, z = parameters.wind_x, parameters.wind_y, parameters.wind_z
    if FEATURE.gust:
        time = stage_time(step, offset, parameters.dt, parameters.first_step, parameters.first_time)
        interval, passed = gust_interval(time, parameters.gust_time)
        before, _, _, _ = philox(integers[2], np.uint64(interval), np.uint64(GUST_STREAM))
        after, _, _, _ = philox(integers[2], np.uint64(interval + 1), np.uint64(GUST_STREAM))
        g, largest = gust(before, after, passed), parameters.gust
        x, y, z = gusty(x, largest, g), gusty(y, largest, g), gusty(z, largest, g)
    return x, y, z


@row_routine
def cell_row(
    blocks, x, y, z, vx, vy, vz, x_below, y_below, z_below, vx_below, vy_below, vz_below, air, drag, lift, first_x,
    first_y, first_z, second_x, second_y, second_z,
):  # fmt: skip
    for j in range(blocks * BLOCK):
        a, va = (x[j], y[j], z[j]), (vx[j], vy[j], vz[j])
        b, vb = (x[j + 1], y[j + 1], z[j + 1]), (vx[j + 1], vy[j + 1], vz[j + 1])
        c, vc = (x_below[j], y_below[j], z_below[j]), (vx_below[j], vy_below[j], vz_below[j])
        d = x_below[j + 1], y_below[j + 1], z_below[j + 1]
        vd = vx_below[j + 1], vy_below[j + 1], vz_below[j + 1]
        px, py, pz = wind_on_triangle(a, c, d, va, vc, vd, air, drag, lift)
        qx, qy, qz = wind_on_triangle(a, d, b, va, vd, vb, air, drag, lift)
        first_x[j] = px
        first_y[j] = py
        first_z[j] = pz
        second_x[j] = qx
        second_y[j] = qy
        second_z[j] = qz


@routine
def wind_cells(i, blocks, layout, source, parameters, air, scratch, width):
    """Write the forces of the triangles between rows `i` and i + 1 into scratch."""
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    here, below = i * stride, (i + 1) * stride
    first, second = FEATURE.at_first + i % 2, FEATURE.at_second + i % 2
    if i + 1 < rows:
        cell_row(
            blocks, row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane),
            row_at(source, here + 3 * plane), row_at(source, here + 4 * plane), row_at(source, here + 5 * plane),
            row_at(source, below), row_at(source, below + plane), row_at(source, below + 2 * plane),
            row_at(source, below + 3 * plane), row_at(source, below + 4 * plane), row_at(source, below + 5 * plane),
            air, parameters.drag, parameters.lift, row_at(scratch, row_start(first, 0, width)),
            row_at(scratch, row_start(first, 1, width)), row_at(scratch, row_start(first, 2, width)),
            row_at(scratch, row_start(second, 0, width)), row_at(scratch, row_start(second, 1, width)),
            row_at(scratch, row_start(second, 2, width)),
        )  # fmt: skip
        clear_column(scratch, first, columns - 1, width)
        clear_column(scratch, second, columns - 1, width)
    else:
        clear_triple(scratch, first, width)
        clear_triple(scratch, second, width)


@row_routine
def add_row(blocks, first, second, first_above, second_above, out):
    for k in range(SPAN, blocks * BLOCK + SPAN):
        central, beside = first[k] + second[k], second[k - 1] + first_above[k]
        opposite = first_above[k - 1] + second_above[k - 1]
        out[k - SPAN] = out[k - SPAN] + ((central + beside) + opposite)


@routine
def add_wind(i, blocks, scratch, width):
    """Add the six forces on each mass of row `i` to `close`."""
    now, above = i % 2, (i + 1) % 2
    for axis in range(AXES):
        add_row(
            blocks, row_at(scratch, row_edge(FEATURE.at_first + now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_second + now, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_first + above, axis, width)),
            row_at(scratch, row_edge(FEATURE.at_second + above, axis, width)),
            row_at(scratch, row_start(FEATURE.at_close, axis, width)),
        )  # fmt: skip


@routine
def corner_state(state, i, j, rows, columns, edge_row, edge_column):
    """Return (position, velocity) of mass (i, j), or beyond the edge of the mass (edge_row, edge_column)."""
    x, y, z, vx, vy, vz = state
    if i < 0 or i >= rows or j < 0 or j >= columns:
        i, j = edge_row, edge_column
    return (x[i, j], y[i, j], z[i, j]), (vx[i, j], vy[i, j], vz[i, j])


@routine
def cell_wind(state, i, j, upper, rows, columns, edge_row, edge_column, air, parameters):
    """Return the wind on each corner of a triangle of cell (i, j): the upper one (A, D, B) or the lower one (A, C, D)."""
    if i < 0 or i >= rows - 1 or j < 0 or j >= columns - 1:
        a, va = corner_state(state, edge_row, edge_column, rows, columns, edge_row, edge_column)
        return wind_on_triangle(a, a, a, va, va, va, air, parameters.drag, parameters.lift)
    a, va = corner_state(state, i, j, rows, columns, edge_row, edge_column)
    d, vd = corner_state(state, i + 1, j + 1, rows, columns, edge_row, edge_column)
    if upper:
        b, vb = corner_state(state, i, j + 1, rows, columns, edge_row, edge_column)
        return wind_on_triangle(a, d, b, va, vd, vb, air, parameters.drag, parameters.lift)
    c, vc = corner_state(state, i + 1, j, rows, columns, edge_row, edge_column)
    return wind_on_triangle(a, c, d, va, vc, vd, air, parameters.drag, parameters.lift)


@routine
def wind(state, record, integers, step, offset, acceleration):
    """Add the wind of the six triangles of each mass."""
    ax, ay, az = acceleration
    rows, columns = ax.shape
    air = air_now(record[0], integers, step, offset)
    for row in prange(rows):
        i = np.int64(row)
        for j in range(columns):
            central = plus(
                cell_wind(state, i, j, False, rows, columns, i, j, air, record[0]),
                cell_wind(state, i, j, True, rows, columns, i, j, air, record[0]),
            )
            beside = plus(
                cell_wind(state, i, j - 1, True, rows, columns, i, j, air, record[0]),
                cell_wind(state, i - 1, j, False, rows, columns, i, j, air, record[0]),
            )
            opposite = plus(
                cell_wind(state, i - 1, j - 1, False, rows, columns, i, j, air, record[0]),
                cell_wind(state, i - 1, j - 1, True, rows, columns, i, j, air, record[0]),
            )
            push_x, push_y, push_z = plus(plus(central, beside), opposite)
            ax[i, j] += push_x
            ay[i, j] += push_y
            az[i, j] += push_z


def wind_features(parts: frozenset[str], at: dict[str, int]) -> dict[str, Feature]:
    """Return the features of `wind_cells` and `add_wind`; `at`: of triples_of."""
    return {
        **features_of(parts), "at_first": at.get("first", 0), "at_second": at.get("second", 0), "at_close": at["close"]
    }  # fmt: skip


def make_wind_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile `wind`."""
    return compiler.kernel(compiler.variant_of(real, features_of(parts)).copied(wind))
