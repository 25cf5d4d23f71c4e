"""Shape matching of a grid, row by row: the clusters around a row's masses, and the displacements from masses to their
goals.

Windows extend `region` masses to either side; formulas/shape_matching/grid.py defines the order of sums. Rows are arrays
of unchecked length (`row_at`), which do not overlap except for the same row read at another offset: a loop goes along the
row for one member of all its windows at a time, and is vectorised. Arrays that belong together (SUMS of a window, and
so on) are rows `stride` apart. `columns`: masses of a row; (x, y): their positions; `table`: of the columns.
"""

from __future__ import annotations

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import add_2d
from softlab.model.assets.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_WEIGHT
from softlab.model.base.variant import FEATURE, real, routine, row_routine
from softlab.model.formulas.distance import kicked, predicted
from softlab.model.formulas.distance import rate as rate_of
from softlab.model.formulas.shape_matching.grid import (
    added_goal,
    added_goal_row,
    added_member,
    added_row,
    moved,
    rest_offset,
)
from softlab.model.formulas.shape_matching.grid import cluster as cluster_of

LINE = 4  # sums along a row of masses
SUMS = 6  # of a window
CLUSTER = 4  # centre (x, y), cosine, sine
GOALS = 6  # sums along a row of clusters


@routine
def window(i, count):
    """Return (first, behind the last) index of the window of index `i`, of `count`."""
    return max(0, i - FEATURE.region), min(count, i + FEATURE.region + 1)


@row_routine
def clear(columns, out):
    for j in range(columns):
        out[j] = 0.0


@row_routine
def add_members(count, step, x, y, weights, middle_x, middle_y, centres, l0, l1, l2, l3):
    for j in range(count):  # from 0: numba takes an index that may be negative as one from the end
        l0[j], l1[j], l2[j], l3[j] = added_member(
            (l0[j], l1[j], l2[j], l3[j]), x[j], y[j], middle_x[j], middle_y[j], weights[j], step, centres[j]
        )


@routine
def sum_line(columns, stride, x, y, table, line):
    """Write, for a row of masses, the sums over windows along it."""
    for k in range(LINE):
        clear(columns, row_at(line, k * stride))
    for place in range(-FEATURE.region, FEATURE.region + 1):
        first = max(0, -place)
        if place != 0:
            add_members(
                columns - abs(place), real(place), row_at(x, first + place), row_at(y, first + place),
                row_at(table, T_WEIGHT * stride + first + place), row_at(x, first), row_at(y, first),
                row_at(table, T_CENTRE * stride + first), row_at(line, first), row_at(line, stride + first),
                row_at(line, 2 * stride + first), row_at(line, 3 * stride + first),
            )  # fmt: skip


@row_routine
def add_row(columns, l0, l1, l2, l3, x, y, here_x, here_y, mass, weight, offset, s0, s1, s2, s3, s4, s5):
    for j in range(columns):
        now = s0[j], s1[j], s2[j], s3[j], s4[j], s5[j]
        s0[j], s1[j], s2[j], s3[j], s4[j], s5[j] = added_row(
            now, (l0[j], l1[j], l2[j], l3[j]), x[j], y[j], here_x[j], here_y[j], mass[j], weight, offset
        )


@routine
def add_window(columns, stride, line, x, here, table, weight, offset, sums):
    """Add the sums of the row of positions `x` to those of the windows around the row `here`.

    `weight`: weight of the row; `offset`: its rest offset below the windows' centres [spacings].
    """
    add_row(
        columns, line, row_at(line, stride), row_at(line, 2 * stride), row_at(line, 3 * stride), x, row_at(x, stride),
        here, row_at(here, stride), row_at(table, T_MASS * stride), weight, offset, sums, row_at(sums, stride),
        row_at(sums, 2 * stride), row_at(sums, 3 * stride), row_at(sums, 4 * stride), row_at(sums, 5 * stride),
    )  # fmt: skip


@row_routine
def finish_row(columns, s0, s1, s2, s3, s4, s5, here_x, here_y, inverse, inverses, x, y, cosine, sine):
    for j in range(columns):
        sums = s0[j], s1[j], s2[j], s3[j], s4[j], s5[j]
        x[j], y[j], cosine[j], sine[j] = cluster_of(sums, here_x[j], here_y[j], inverse, inverses[j])


@routine
def finish(columns, stride, sums, here_x, here_y, inverse, table, cluster):
    """Write the clusters of a row from the sums of their windows."""
    finish_row(
        columns, sums, row_at(sums, stride), row_at(sums, 2 * stride), row_at(sums, 3 * stride),
        row_at(sums, 4 * stride), row_at(sums, 5 * stride), here_x, here_y, inverse, row_at(table, T_INVERSE * stride),
        cluster, row_at(cluster, stride), row_at(cluster, 2 * stride), row_at(cluster, 3 * stride),
    )  # fmt: skip


@row_routine
def add_clusters(count, step, c0, c1, c2, c3, middle_x, middle_y, centres, rest, g0, g1, g2, g3, g4, g5):
    for j in range(count):
        now = g0[j], g1[j], g2[j], g3[j], g4[j], g5[j]
        along = rest_offset(step, centres[j], rest)
        g0[j], g1[j], g2[j], g3[j], g4[j], g5[j] = added_goal(
            now, c0[j], c1[j], middle_x[j], middle_y[j], c2[j], c3[j], along
        )


@routine
def sum_goals(columns, stride, cluster, table, rest, goals):
    """Write, for a row of clusters, the sums over windows along it."""
    for k in range(GOALS):
        clear(columns, row_at(goals, k * stride))
    for number in range(2 * FEATURE.region + 1):
        place = 0 if number == 0 else number - 1 - FEATURE.region + (number > FEATURE.region)  # the middle one first
        first = max(0, -place)
        there = first + place
        add_clusters(
            columns - abs(place), real(-place), row_at(cluster, there), row_at(cluster, stride + there),
            row_at(cluster, 2 * stride + there), row_at(cluster, 3 * stride + there), row_at(cluster, first),
            row_at(cluster, stride + first), row_at(table, T_CENTRE * stride + there), rest, row_at(goals, first),
            row_at(goals, stride + first), row_at(goals, 2 * stride + first), row_at(goals, 3 * stride + first),
            row_at(goals, 4 * stride + first), row_at(goals, 5 * stride + first),
        )  # fmt: skip


@row_routine
def add_goal_rows(columns, g0, g1, g2, g3, g4, g5, c0, c1, x, y, counts, down, displacement_x, displacement_y):
    for j in range(columns):
        sums = g0[j], g1[j], g2[j], g3[j], g4[j], g5[j]
        displacement_x[j], displacement_y[j] = added_goal_row(
            displacement_x[j], displacement_y[j], sums, x[j], y[j], c0[j], c1[j], counts[j], down
        )


@routine
def add_goals(columns, stride, goals, cluster, x, y, table, down, displacement_x, displacement_y):
    """Add the displacements to the goals of a row of clusters to those of the masses (x, y), which at rest are `down`
    [m] below its centres."""
    add_goal_rows(
        columns, goals, row_at(goals, stride), row_at(goals, 2 * stride), row_at(goals, 3 * stride),
        row_at(goals, 4 * stride), row_at(goals, 5 * stride), cluster, row_at(cluster, stride), x, y,
        row_at(table, T_COUNT * stride), down, displacement_x, displacement_y,
    )  # fmt: skip


@routine
def accelerate(i, step, columns, stride, parameters, integers, kick):
    """Write the accelerations of a row of masses, along both axes."""
    for j in range(columns):
        kick[j], kick[stride + j] = 0.0, parameters.gravity if FEATURE.gravity else 0.0
    if FEATURE.particle_forces:
        add_2d(columns, i * columns, step, parameters, integers, kick, row_at(kick, stride))


@row_routine
def predict(columns, position, velocity, acceleration, weights, parameters, out):
    factor, h = parameters.keep if FEATURE.damping else 1.0, parameters.dt
    for j in range(columns):
        p = position[j]
        v = kicked(velocity[j], factor, h, acceleration[j])
        out[j] = predicted(p, h, v) if weights[j] > 0.0 else p


@row_routine
def copy(columns, source, out):
    for j in range(columns):
        out[j] = source[j]


@row_routine
def move(columns, position, displacement, weights, row_weight, column_weights, parameters, out):
    matching = parameters.matching
    for j in range(columns):
        new = moved(position[j], row_weight, column_weights[j], matching, displacement[j])
        out[j] = new if weights[j] > 0.0 else position[j]


@row_routine
def rate(columns, position, before, weights, parameters, out):
    inverse = parameters.inverse_substep
    for j in range(columns):
        v = rate_of(position[j], before[j], inverse)
        out[j] = v if weights[j] > 0.0 else 0.0
