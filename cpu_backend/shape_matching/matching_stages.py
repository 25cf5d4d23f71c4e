"""Shape matching of a grid on CPU threads, the two stages of an iteration: all clusters, then all masses."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.shape_matching.matching_rows import window
from softlab.model.assets.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_WEIGHT
from softlab.model.base.types import Real
from softlab.model.base.variant import real, routine
from softlab.model.formulas.shape_matching.grid import (
    added_goal,
    added_goal_row,
    added_member,
    added_row,
    moved,
    rest_offset,
)
from softlab.model.formulas.shape_matching.grid import cluster as cluster_of

AXES = 2


@routine
def match_mass(i, j, position, row_table, table):
    """Return (centre, cosine, sine) of the cluster around a mass."""
    x, y = position[0, i, j], position[1, i, j]
    sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    top, bottom = window(i, position.shape[1])
    left, right = window(j, position.shape[2])
    for row in range(top, bottom):
        line = (0.0, 0.0, 0.0, 0.0)
        middle_x, middle_y = position[0, row, j], position[1, row, j]
        for k in range(left, right):
            if k != j:
                line = added_member(
                    line, position[0, row, k], position[1, row, k], middle_x, middle_y, table[T_WEIGHT, k],
                    real(k - j), table[T_CENTRE, j],
                )  # fmt: skip
        sums = added_row(
            sums, line, middle_x, middle_y, x, y, table[T_MASS, j],
            row_table[T_WEIGHT, row], real(row - i) - row_table[T_CENTRE, i],
        )  # fmt: skip
    return cluster_of(sums, x, y, row_table[T_INVERSE, i], table[T_INVERSE, j])


@routine
def displacement_of_mass(i, j, position, clusters, row_table, table, rest):
    """Return the displacement of a mass to its goals."""
    x, y, displacement_x, displacement_y = position[0, i, j], position[1, i, j], 0.0, 0.0
    top, bottom = window(i, position.shape[1])
    left, right = window(j, position.shape[2])
    for row in range(top, bottom):
        middle_x, middle_y = clusters[0, row, j], clusters[1, row, j]
        sums = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for number in range(left - 1, right):
            k = j if number < left else number  # the middle one first
            if number != j:
                sums = added_goal(
                    sums, clusters[0, row, k], clusters[1, row, k], middle_x, middle_y, clusters[2, row, k],
                    clusters[3, row, k], rest_offset(real(j - k), table[T_CENTRE, k], rest),
                )  # fmt: skip
        down = rest_offset(real(i - row), row_table[T_CENTRE, row], rest)
        displacement_x, displacement_y = added_goal_row(
            displacement_x, displacement_y, sums, x, y, middle_x, middle_y, table[T_COUNT, j], down
        )
    return displacement_x, displacement_y


@routine
def match(position, row_table, column_table, clusters):
    for u in prange(position.shape[1]):
        i = np.int64(u)
        for j in range(position.shape[2]):
            cluster = match_mass(i, j, position, row_table, column_table)
            clusters[0, i, j], clusters[1, i, j], clusters[2, i, j], clusters[3, i, j] = cluster


@routine
def move(position, clusters, row_table, column_table, weights, record, out):
    for u in prange(position.shape[1]):
        i = np.int64(u)
        for j in range(position.shape[2]):
            displacements = displacement_of_mass(
                i, j, position, clusters, row_table, column_table, record[0].matching_rest
            )
            for axis in range(AXES):
                mass_weights = row_table[T_WEIGHT, i], column_table[T_WEIGHT, j]
                now = position[axis, i, j]
                new = moved(now, mass_weights[0], mass_weights[1], record[0].matching, displacements[axis])
                out[axis, i, j] = new if weights[i, j] > 0.0 else now


@cache
def make_matching_stages(real: Real, math: str, region: int) -> SimpleNamespace:
    """Compile `match` and `move`.

    `match(position, row_table, column_table, clusters)`: clusters (4, rows, columns) of position (2, rows, columns),
    with tables (5, n). `move(position, clusters, row_table, column_table, weights, parameters, out)`: the masses that
    are not pinned, to `out` (2, rows, columns).
    """
    compiler = Compiler(f"matching_{np.dtype(real).name}_{math}_{region}_", math)
    copied = compiler.variant_of(real, {"region": region}).copied
    return SimpleNamespace(match=compiler.kernel(copied(match)), move=compiler.kernel(copied(move)))
