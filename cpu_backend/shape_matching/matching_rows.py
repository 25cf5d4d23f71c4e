"""Shape matching of a grid, row by row: the clusters around a row's masses, and the displacements from masses to their
goals.

Windows extend `region` masses to either side; formulas/shape_matching.py defines the order of sums. Rows are arrays of
unchecked length (`row_at`), which do not overlap except for the same row read at another offset: a loop goes along the
row for one member of all its windows at a time, and is vectorised. Arrays that belong together (SUMS of a window, and
so on) are rows `stride` apart. `columns`: masses of a row; (x, y): their positions; `table`: of the columns.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import make_particle_force_row
from softlab.model.assets.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_WEIGHT
from softlab.model.base.types import Real
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas import distance
from softlab.model.formulas.shape_matching import grid as shape_matching

LINE = 4  # sums along a row of masses
SUMS = 6  # of a window
CLUSTER = 4  # centre (x, y), cosine, sine
GOALS = 6  # sums along a row of clusters


def make_clear(compiler: Compiler, real: Real) -> Callable:
    """Make clear(columns, row)."""
    zero = real(0)

    @compiler.row
    def clear(columns, out):
        for j in range(columns):
            out[j] = zero

    return clear


def make_cluster_rows(compiler: Compiler, real: Real, region: int) -> SimpleNamespace:
    """Make `sum_line`, `add_window` and `finish`.

    `sum_line(columns, stride, x, y, table, line)`: the sums along a row. `add_window(columns, stride, line, x, here,
    table, weight, offset, sums)`: add the sums of the row of positions `x` to those of the windows around the row `here`;
    `weight`: weight of the row; `offset`: its rest offset below their centres [spacings]. `finish(columns, stride, sums,
    here_x, here_y, inverse, table, cluster)`: the clusters.
    """
    compiled, row, clear = compiler.compiled, compiler.row, make_clear(compiler, real)
    formulas = compiler.formulas(shape_matching, real, inline=True)
    added_member, added_row, cluster = formulas.added_member, formulas.added_row, formulas.cluster

    @row
    def add_members(count, step, x, y, weights, middle_x, middle_y, centres, l0, l1, l2, l3):
        for j in range(count):  # from 0: numba takes an index that may be negative as one from the end
            l0[j], l1[j], l2[j], l3[j] = added_member(
                (l0[j], l1[j], l2[j], l3[j]), x[j], y[j], middle_x[j], middle_y[j], weights[j], step, centres[j]
            )

    @compiled
    def sum_line(columns, stride, x, y, table, line):
        for k in range(LINE):
            clear(columns, row_at(line, k * stride))
        for place in range(-region, region + 1):
            first = max(0, -place)
            if place != 0:
                add_members(
                    columns - abs(place), real(place), row_at(x, first + place), row_at(y, first + place),
                    row_at(table, T_WEIGHT * stride + first + place), row_at(x, first), row_at(y, first),
                    row_at(table, T_CENTRE * stride + first), row_at(line, first), row_at(line, stride + first),
                    row_at(line, 2 * stride + first), row_at(line, 3 * stride + first),
                )  # fmt: skip

    @row
    def add_row(columns, l0, l1, l2, l3, x, y, here_x, here_y, mass, weight, offset, s0, s1, s2, s3, s4, s5):
        for j in range(columns):
            now = s0[j], s1[j], s2[j], s3[j], s4[j], s5[j]
            s0[j], s1[j], s2[j], s3[j], s4[j], s5[j] = added_row(
                now, (l0[j], l1[j], l2[j], l3[j]), x[j], y[j], here_x[j], here_y[j], mass[j], weight, offset
            )

    @compiled
    def add_window(columns, stride, line, x, here, table, weight, offset, sums):
        add_row(
            columns, line, row_at(line, stride), row_at(line, 2 * stride), row_at(line, 3 * stride), x, row_at(x, stride),
            here, row_at(here, stride), row_at(table, T_MASS * stride), weight, offset, sums, row_at(sums, stride),
            row_at(sums, 2 * stride), row_at(sums, 3 * stride), row_at(sums, 4 * stride), row_at(sums, 5 * stride),
        )  # fmt: skip

    @row
    def finish_row(columns, s0, s1, s2, s3, s4, s5, here_x, here_y, inverse, inverses, x, y, cosine, sine):
        for j in range(columns):
            sums = s0[j], s1[j], s2[j], s3[j], s4[j], s5[j]
            x[j], y[j], cosine[j], sine[j] = cluster(sums, here_x[j], here_y[j], inverse, inverses[j])

    @compiled
    def finish(columns, stride, sums, here_x, here_y, inverse, table, cluster):
        finish_row(
            columns, sums, row_at(sums, stride), row_at(sums, 2 * stride), row_at(sums, 3 * stride),
            row_at(sums, 4 * stride), row_at(sums, 5 * stride), here_x, here_y, inverse, row_at(table, T_INVERSE * stride),
            cluster, row_at(cluster, stride), row_at(cluster, 2 * stride), row_at(cluster, 3 * stride),
        )  # fmt: skip

    return SimpleNamespace(sum_line=sum_line, add_window=add_window, finish=finish)


def make_goal_rows(compiler: Compiler, real: Real, region: int) -> SimpleNamespace:
    """Make `sum_goals` and `add_goals`.

    `sum_goals(columns, stride, cluster, table, rest, goals)`: the sums along a row of clusters. `add_goals(columns,
    stride, goals, cluster, x, y, table, down, displacement_x, displacement_y)`: add the displacements to the goals of a
    row of clusters to those of the masses (x, y), which at rest are `down` [m] below its centres.
    """
    compiled, row, clear = compiler.compiled, compiler.row, make_clear(compiler, real)
    formulas = compiler.formulas(shape_matching, real, inline=True)
    rest_offset, added_goal, added_goal_row = formulas.rest_offset, formulas.added_goal, formulas.added_goal_row

    @row
    def add_clusters(count, step, c0, c1, c2, c3, middle_x, middle_y, centres, rest, g0, g1, g2, g3, g4, g5):
        for j in range(count):
            now = g0[j], g1[j], g2[j], g3[j], g4[j], g5[j]
            along = rest_offset(step, centres[j], rest)
            g0[j], g1[j], g2[j], g3[j], g4[j], g5[j] = added_goal(
                now, c0[j], c1[j], middle_x[j], middle_y[j], c2[j], c3[j], along
            )

    @compiled
    def sum_goals(columns, stride, cluster, table, rest, goals):
        for k in range(GOALS):
            clear(columns, row_at(goals, k * stride))
        for number in range(2 * region + 1):
            place = 0 if number == 0 else number - 1 - region + (number > region)  # the middle one first
            first = max(0, -place)
            there = first + place
            add_clusters(
                columns - abs(place), real(-place), row_at(cluster, there), row_at(cluster, stride + there),
                row_at(cluster, 2 * stride + there), row_at(cluster, 3 * stride + there), row_at(cluster, first),
                row_at(cluster, stride + first), row_at(table, T_CENTRE * stride + there), rest, row_at(goals, first),
                row_at(goals, stride + first), row_at(goals, 2 * stride + first), row_at(goals, 3 * stride + first),
                row_at(goals, 4 * stride + first), row_at(goals, 5 * stride + first),
            )  # fmt: skip

    @row
    def add_goal_rows(columns, g0, g1, g2, g3, g4, g5, c0, c1, x, y, counts, down, displacement_x, displacement_y):
        for j in range(columns):
            sums = g0[j], g1[j], g2[j], g3[j], g4[j], g5[j]
            displacement_x[j], displacement_y[j] = added_goal_row(
                displacement_x[j], displacement_y[j], sums, x[j], y[j], c0[j], c1[j], counts[j], down
            )

    @compiled
    def add_goals(columns, stride, goals, cluster, x, y, table, down, displacement_x, displacement_y):
        add_goal_rows(
            columns, goals, row_at(goals, stride), row_at(goals, 2 * stride), row_at(goals, 3 * stride),
            row_at(goals, 4 * stride), row_at(goals, 5 * stride), cluster, row_at(cluster, stride), x, y,
            row_at(table, T_COUNT * stride), down, displacement_x, displacement_y,
        )  # fmt: skip

    return SimpleNamespace(sum_goals=sum_goals, add_goals=add_goals)


def make_motion_rows(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the operations on one row, along one axis each, except for `accelerate`, which fills the rows of both."""
    compiled, row = compiler.compiled, compiler.row
    points, moved = compiler.formulas(distance, real), compiler.formulas(shape_matching, real).moved
    kicked, predicted, rate_of = points.kicked, points.predicted, points.rate
    add_particle_force, has_particle_forces = (
        make_particle_force_row(compiler, real, 2, parts),
        bool(particle_forces(parts)),
    )
    has_gravity, has_damping = "gravity" in parts, "damping" in parts
    zero, one = real(0), real(1)

    @compiled
    def accelerate(i, step, columns, stride, parameters, integers, kick):
        for j in range(columns):
            kick[j], kick[stride + j] = zero, parameters.gravity if has_gravity else zero
        if has_particle_forces:
            add_particle_force(columns, i * columns, step, parameters, integers, kick, row_at(kick, stride))

    @row
    def predict(columns, position, velocity, acceleration, weights, parameters, out):
        factor, h = parameters.keep if has_damping else one, parameters.dt
        for j in range(columns):
            p = position[j]
            v = kicked(velocity[j], factor, h, acceleration[j])
            out[j] = predicted(p, h, v) if weights[j] > zero else p

    @row
    def copy(columns, source, out):
        for j in range(columns):
            out[j] = source[j]

    @row
    def move(columns, position, displacement, weights, row_weight, column_weights, parameters, out):
        matching = parameters.matching
        for j in range(columns):
            new = moved(position[j], row_weight, column_weights[j], matching, displacement[j])
            out[j] = new if weights[j] > zero else position[j]

    @row
    def rate(columns, position, before, weights, parameters, out):
        inverse = parameters.inverse_substep
        for j in range(columns):
            v = rate_of(position[j], before[j], inverse)
            out[j] = v if weights[j] > zero else zero

    return SimpleNamespace(accelerate=accelerate, predict=predict, copy=copy, move=move, rate=rate)
