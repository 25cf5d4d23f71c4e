"""Shape matching of a grid on CPU threads, the two stages of an iteration: all clusters, then all masses."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.model.assets.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_WEIGHT
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import grid as shape_matching

AXES = 2


@cache
def make_matching_stages(real: Real, math: str, region: int) -> SimpleNamespace:
    """Compile `match` and `move`.

    `match(position, row_table, column_table, clusters)`: clusters (4, rows, columns) of position (2, rows, columns),
    with tables (5, n). `move(position, clusters, row_table, column_table, weights, parameters, out)`: the masses that
    are not pinned, to `out` (2, rows, columns).
    """
    compiler = Compiler(f"matching_{np.dtype(real).name}_{math}_{region}_", math)
    compiled = compiler.compiled
    formulas = compiler.formulas(shape_matching, real)
    added_member, added_row, cluster = formulas.added_member, formulas.added_row, formulas.cluster
    rest_offset, added_goal, added_goal_row = formulas.rest_offset, formulas.added_goal, formulas.added_goal_row
    moved, zero, one = formulas.moved, real(0), np.int64(1)

    @compiled
    def window(i, count):
        return max(0, i - region), min(count, i + region + one)

    @compiled
    def match_mass(i, j, position, row_table, table):
        x, y = position[0, i, j], position[1, i, j]
        sums = (zero, zero, zero, zero, zero, zero)
        top, bottom = window(i, position.shape[1])
        left, right = window(j, position.shape[2])
        for row in range(top, bottom):
            line = (zero, zero, zero, zero)
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
        return cluster(sums, x, y, row_table[T_INVERSE, i], table[T_INVERSE, j])

    @compiled
    def displacement_of_mass(i, j, position, clusters, row_table, table, rest):
        x, y, displacement_x, displacement_y = position[0, i, j], position[1, i, j], zero, zero
        top, bottom = window(i, position.shape[1])
        left, right = window(j, position.shape[2])
        for row in range(top, bottom):
            middle_x, middle_y = clusters[0, row, j], clusters[1, row, j]
            sums = (zero, zero, zero, zero, zero, zero)
            for number in range(left - one, right):
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

    @compiler.kernel
    def match(position, row_table, column_table, clusters):
        for u in prange(position.shape[1]):
            i = np.int64(u)
            for j in range(position.shape[2]):
                cluster = match_mass(i, j, position, row_table, column_table)
                clusters[0, i, j], clusters[1, i, j], clusters[2, i, j], clusters[3, i, j] = cluster

    @compiler.kernel
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
                    out[axis, i, j] = new if weights[i, j] > zero else now

    return SimpleNamespace(match=match, move=move)
