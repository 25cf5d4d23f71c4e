"""The coarse level of Newton's method on tetrahedra, on CPU threads: groups sum their rows, one thread factors and
solves.

newton_arrays.py describes `rows`, `groups` and `coarse`.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import routine, unrolled
from softlab.model.formulas.elastic.coarse import arm, columns, moment, motion, pivot, scale_of
from softlab.model.tetrahedra.aggregates import MODES

NO_MOMENTS = (0.0,) * MODES


@routine
def arm_of(k, group, position, centres):
    """Return the vector to particle k from the group's centre, scaled."""
    return arm(
        position[k, 0], position[k, 1], position[k, 2], centres[group, 0], centres[group, 1], centres[group, 2],
        centres[group, 3],
    )  # fmt: skip


@routine
def centre(first, last, position, groups, coarse):
    """Write centres and scales of groups."""
    starts, members, centres = groups.starts, groups.members, coarse.centres
    for group in range(first, last):
        x, y, z, squares, count = 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(starts[group], starts[group + 1]):
            k = members[n]
            x, y, z, count = x + position[k, 0], y + position[k, 1], z + position[k, 2], count + 1.0
        x, y, z = x / count, y / count, z / count
        for n in range(starts[group], starts[group + 1]):
            k = members[n]
            p, q, r = arm(position[k, 0], position[k, 1], position[k, 2], x, y, z, 1.0)
            squares = squares + ((p * p + q * q) + r * r)
        centres[group, 0], centres[group, 1], centres[group, 2] = x, y, z
        centres[group, 3] = scale_of(squares, count)


@routine
def gather(first, last, position, rows, blocks, groups, coarse):
    """Sum the rows of groups into the coarse matrix."""
    row_starts, row_columns = rows.starts, rows.columns
    starts, last_column = groups.starts, groups.last_column
    centres, band = coarse.centres, coarse.band
    for group in range(first, last):
        for i in range(MODES * group, MODES * (group + 1)):
            for j in range(band.shape[1]):
                band[i, j] = 0.0
        for n in range(starts[group], starts[group + 1]):
            k = groups.members[n]
            d = arm_of(k, group, position, centres)
            for b in range(row_starts[k], row_starts[k + 1]):
                other = groups.group[row_columns[b]]
                if other < group or MODES * other > last_column[MODES * group]:  # a group of another body
                    continue
                e = arm_of(row_columns[b], other, position, centres)
                block = columns(d, e, tuple(blocks[b, m] for m in unrolled(9)))
                for j in range(MODES):
                    for i in range(MODES):
                        place = MODES * (other - group) + j - i
                        if place >= 0:
                            band[MODES * group + i, place] = band[MODES * group + i, place] + block[j][i]


@routine
def restrict(first, last, position, residual, groups, coarse):
    """Write the residual of groups, projected onto rigid motions."""
    starts, members = groups.starts, groups.members
    for group in range(first, last):
        sums = NO_MOMENTS
        for n in range(starts[group], starts[group + 1]):
            k = members[n]
            arm_now = arm_of(k, group, position, coarse.centres)
            moments = moment(arm_now, residual[k, 0], residual[k, 1], residual[k, 2])
            sums = tuple(sums[mode] + moments[mode] for mode in unrolled(MODES))
        for mode in unrolled(MODES):
            coarse.solution[0, MODES * group + mode] = sums[mode]


@routine
def corrected(k, position, groups, coarse):
    """Return three numbers to add at particle k."""
    group, solution = groups.group[k], coarse.solution
    place = MODES * group
    y = tuple(solution[0, place + n] for n in unrolled(MODES))
    return motion(arm_of(k, group, position, coarse.centres), y)


@routine
def subtract(band, i, k, many, factor):
    """Subtract `factor` times row k, from column i on, from row i, `many` entries."""
    for j in range(many):
        band[i, j] = band[i, j] - factor * band[k, i - k + j]


@routine
def factor(coarse, groups):
    """Factor the coarse matrix; for one thread. Returns true if it is not positive."""
    band, last_columns, size = coarse.band, groups.last_column, coarse.band.shape[0]
    entries = coarse.diagonal
    for k in range(size):
        entries[0, k] = band[k, 0]
    bad = False
    for k in range(size):
        inverse, negative = pivot(band[k, 0], entries[0, k])
        bad = bad or negative
        last = np.int64(last_columns[k])
        band[k, 0] = inverse  # inverse of U's diagonal
        for j in range(1, last - k + 1):
            band[k, j] = inverse * band[k, j]
        for i in range(k + 1, last + 1):
            subtract(band, i, k, last - i + 1, band[k, i - k])
    return bad


@routine
def solve(coarse, groups):
    """Solve the coarse system; for one thread."""
    band, solution, last_columns, size = coarse.band, coarse.solution, groups.last_column, coarse.band.shape[0]
    for k in range(size):
        y = band[k, 0] * solution[0, k]
        solution[0, k] = y
        for j in range(1, np.int64(last_columns[k]) - k + 1):
            solution[0, k + j] = solution[0, k + j] - y * band[k, j]
    for m in range(size):
        k = size - 1 - m
        total = solution[0, k]
        for j in range(np.int64(last_columns[k]) - k, 0, -1):  # known entries first: a GPU need not wait
            total = total - band[k, j] * solution[0, k + j]
        solution[0, k] = band[k, 0] * total
