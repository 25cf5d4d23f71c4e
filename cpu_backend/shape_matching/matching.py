"""Shape matching of a grid on CPU threads: the two stages of an iteration by themselves, and a whole iteration in one pass.

`make_matching_stages`: all clusters, then all masses. `make_matching_advance`: each thread goes down a band of rows once an
iteration, a row of predictions, a row of clusters and a row of masses at a time, the rows between kept in a ring that
stays in the first cache. The rows that windows reach beyond a band are done by both neighbours: no thread waits for another.
In `exact` math both give the same bits, for any number of threads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from cpu_backend.core.progress import shares
from cpu_backend.shape_matching.matching_rows import (
    CLUSTER,
    GOALS,
    LINE,
    SUMS,
    make_matching_rows,
)
from model.formulas import distance, random, shape_matching
from model.mass_spring.cloth_parameters import C_DT, C_EXTERNAL, C_GRAVITY, C_POKE_X
from model.shape_matching.lattice import T_CENTRE, T_COUNT, T_INVERSE, T_MASS, T_SHARE
from model.xpbd.parameters import X_INVERSE_SUBSTEP, X_KEEP, X_MATCHING, X_MATCHING_REST

AXES = 2
PLACE = AXES + LINE  # rows of a ring: of a row of masses ...
GOAL = CLUSTER + GOALS  # ... and of one of clusters
STATES = 3  # of a substep: its beginning, and two that iterations take in turn
ONCE, FIRST, MIDDLE, LAST = range(4)  # which iteration of a substep a pass is; ONCE: first and last


def _compiler(real: Any, math: str, region: int, parts: frozenset[str]) -> Compiler:
    words = "_".join(sorted(parts))
    return Compiler(f"matching_{np.dtype(real).name}_{math}_{region}_{words}", math)


@cache
def make_matching_stages(real: Any, math: str, region: int) -> SimpleNamespace:
    """`match(position, row_table, column_table, clusters)`: clusters (4, rows, columns) of position (2, rows, columns), by
    tables (5, n). `move(position, clusters, row_table, column_table, weights, record, out)`: the masses that are not pinned,
    to `out` (2, rows, columns)."""
    compiler = _compiler(real, math, region, frozenset())
    compiled = compiler.compiled
    formulas = shape_matching.make(real, compiled)
    added_member, added_row, found = formulas.added_member, formulas.added_row, formulas.cluster
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
                        line[0], line[1], line[2], line[3], position[0, row, k], position[1, row, k], middle_x, middle_y,
                        table[T_SHARE, k], real(k - j), table[T_CENTRE, j],
                    )  # fmt: skip
            sums = added_row(
                sums, line[0], line[1], line[2], line[3], middle_x, middle_y, x, y, table[T_MASS, j],
                row_table[T_SHARE, row], real(row - i) - row_table[T_CENTRE, i],
            )  # fmt: skip
        return found(sums, x, y, row_table[T_INVERSE, i], table[T_INVERSE, j])

    @compiled
    def way_of_mass(i, j, position, clusters, row_table, table, rest):
        x, y, way_x, way_y = position[0, i, j], position[1, i, j], zero, zero
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
            way_x, way_y = added_goal_row(way_x, way_y, sums, x, y, middle_x, middle_y, table[T_COUNT, j], down)
        return way_x, way_y

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
                ways = way_of_mass(i, j, position, clusters, row_table, column_table, record[X_MATCHING_REST])
                for axis in range(AXES):
                    shares = row_table[T_SHARE, i], column_table[T_SHARE, j]
                    now = position[axis, i, j]
                    new = moved(now, shares[0], shares[1], record[X_MATCHING], ways[axis])
                    out[axis, i, j] = new if weights[i, j] > zero else now

    return SimpleNamespace(match=match, move=move)


@cache
def make_matching_advance(real: Any, math: str, region: int, parts: frozenset[str]) -> Any:
    """advance(bands, steps, step, substeps, iterations, bounds, rows, columns, stride, states, current, row_table,
    column_table, weights, record, integers, scratch, room, place_after).

    `bounds` (bands + 1,): the bands' first rows; `states`: flat, STATES of them, each four planes of `rows` rows `stride`
    apart; `current`: which is the state now; tables (3, rows) and flat, rows `stride` apart; `weights`: flat, likewise, 0
    where pinned; `scratch`: flat, `room` numbers a band; `place_after` (1,): which of the states is the state then.
    """
    compiler = _compiler(real, math, region, parts)
    compiled = compiler.compiled
    line = make_matching_rows(compiler, real, region)
    window, clear, sum_line, add_window = line.window, line.clear, line.sum_line, line.add_window
    finish, sum_goals, add_goals = line.finish, line.sum_goals, line.add_goals
    rest_offset = shape_matching.make(real, compiled).rest_offset
    walk = make_walk(compiler, real, parts)
    accelerate, predict, copy = walk.accelerate, walk.predict, walk.copy
    move, rate = walk.move, walk.rate
    ring = 2 * region + 1
    at_clusters = PLACE * ring  # rows of a band's scratch
    at_sums = at_clusters + GOAL * ring
    at_ways = at_sums + SUMS
    at_kick = at_ways + AXES

    @compiled
    def bring(far, step, predicting, rows, columns, stride, begin, before, table, weights, record, integers, room):
        """The positions of row `far`, into the ring: predicted, or as the iteration before left them; and their sums."""
        kick = row_at(room, at_kick * stride)
        if predicting:
            accelerate(far, step, columns, stride, record, integers, kick)
        for axis in range(AXES):
            into = row_at(room, (PLACE * (far % ring) + axis) * stride)
            place = (axis * rows + far) * stride
            if predicting:
                predict(
                    columns, row_at(begin, place), row_at(begin, place + AXES * rows * stride), row_at(kick, axis * stride),
                    row_at(weights, far * stride), record, into,
                )  # fmt: skip
            else:
                copy(columns, row_at(before, place), into)
        x = row_at(room, PLACE * (far % ring) * stride)
        sum_line(columns, stride, x, row_at(x, stride), table, row_at(x, AXES * stride))

    @compiled
    def match(i, rows, columns, stride, row_table, table, rest, room):
        """The clusters of row i and their sums, into their ring."""
        sums = row_at(room, at_sums * stride)
        clear(SUMS * stride, sums)
        here = row_at(room, PLACE * (i % ring) * stride)
        here_y = row_at(here, stride)
        first, last = window(i, rows)
        for other in range(first, last):
            offset = real(other - i) - row_table[T_CENTRE, i]
            x = row_at(room, PLACE * (other % ring) * stride)
            add_window(
                columns, stride, row_at(x, AXES * stride), x, row_at(x, stride), here, here_y, table,
                row_table[T_SHARE, other], offset, sums,
            )  # fmt: skip
        cluster = row_at(room, (at_clusters + GOAL * (i % ring)) * stride)
        finish(columns, stride, sums, here, here_y, row_table[T_INVERSE, i], table, cluster)
        sum_goals(columns, stride, cluster, table, rest, row_at(cluster, CLUSTER * stride))

    @compiled
    def arrive(i, ending, rows, columns, stride, begin, after, row_table, table, weights, record, room):
        """The masses of row i towards their goals, and at a substep's end their velocities."""
        ways, rest = row_at(room, at_ways * stride), record[X_MATCHING_REST]
        clear(AXES * stride, ways)
        here = row_at(room, PLACE * (i % ring) * stride)
        first, last = window(i, rows)
        for other in range(first, last):
            down = rest_offset(real(i - other), row_table[T_CENTRE, other], rest)
            cluster = row_at(room, (at_clusters + GOAL * (other % ring)) * stride)
            add_goals(
                columns, stride, row_at(cluster, CLUSTER * stride), cluster, here, row_at(here, stride), table, down, ways,
                row_at(ways, stride),
            )  # fmt: skip
        for axis in range(AXES):
            place = (axis * rows + i) * stride
            here_weights, out = row_at(weights, i * stride), row_at(after, place)
            move(
                columns, row_at(here, axis * stride), row_at(ways, axis * stride), here_weights, row_table[T_SHARE, i], table,
                record, out,
            )  # fmt: skip
            if ending:
                new = row_at(after, place + AXES * rows * stride)
                rate(columns, out, row_at(begin, place), here_weights, record, new)

    @compiled
    def down_band(
        first,
        last,
        kind,
        step,
        rows,
        columns,
        stride,
        begin,
        before,
        after,
        row_table,
        table,
        weights,
        record,
        integers,
        room,
    ):
        """One iteration of the rows first to before last: from the positions `before`, or of a first iteration from the state
        `begin`, to those of `after`; of a last one its velocities too."""
        for far in range(max(0, first - 2 * region), last + 2 * region):
            if far < rows:
                predicting = kind in (ONCE, FIRST)
                bring(
                    far, step, predicting, rows, columns, stride, begin, before, table, weights, record, integers, room
                )
            near = far - region
            if 0 <= near < rows and first - region <= near < last + region:
                match(near, rows, columns, stride, row_table, table, record[X_MATCHING_REST], room)
            i = near - region
            if first <= i < last:
                ending = kind in (ONCE, LAST)
                arrive(i, ending, rows, columns, stride, begin, after, row_table, table, weights, record, room)

    def advance(
        team, member, bands, steps, step, substeps, iterations, bounds, rows, columns, stride, states, current, row_table,
        table, weights, record, integers, scratch, room, place_after,
    ):  # fmt: skip
        size = 2 * AXES * rows * stride
        now, begin = current, current
        for place in range(steps * substeps):
            for iteration in range(iterations):
                kind = MIDDLE
                if iteration == iterations - 1:
                    kind = LAST if iteration > 0 else ONCE
                elif iteration == 0:
                    kind = FIRST
                after = (now + 1) % STATES
                if after == begin and iteration > 0:
                    after = (after + 1) % STATES
                for band in shares(team, member, bands):
                    down_band(
                        bounds[band], bounds[band + 1], kind, step + place // substeps, rows, columns, stride,
                        row_at(states, begin * size), row_at(states, now * size), row_at(states, after * size), row_table,
                        table, weights, record, integers, row_at(scratch, band * room),
                    )  # fmt: skip
                now = after
            begin = now
        if member == 0:
            place_after[0] = now

    return compiler.team(advance)


def make_walk(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """What is done to one row, along one axis each but for `accelerate`, which fills the rows of both."""
    compiled, row = compiler.compiled, compiler.row
    points, moved = distance.make(real, compiled), shape_matching.make(real, compiled).moved
    kicked, predicted, rate_of = points.kicked, points.predicted, points.rate
    philox, add_external = random.make_philox(compiled), random.make(real, compiled).add_external
    has_gravity, has_damping = "gravity" in parts, "damping" in parts
    has_external, has_poke = "external" in parts, "poke" in parts
    zero, one = real(0), real(1)

    @compiled
    def accelerate(i, step, columns, stride, record, integers, kick):
        for j in range(columns):
            kick[j], kick[stride + j] = zero, record[C_GRAVITY] if has_gravity else zero
        if has_external:
            for j in range(columns):
                words = philox(integers[0], np.uint64(step), np.uint64(i * columns + j))
                kick[j] += add_external(zero, record[C_EXTERNAL], words[0])
                kick[stride + j] += add_external(zero, record[C_EXTERNAL], words[1])
        if has_poke:
            poked = np.int64(integers[1]) - 1  # -1: none
            if poked >= 0 and poked // columns == i:
                kick[poked % columns] += record[C_POKE_X]
                kick[stride + poked % columns] += record[C_POKE_X + 1]

    @row
    def predict(columns, position, velocity, acceleration, weights, record, out):
        keep, h = record[X_KEEP] if has_damping else one, record[C_DT]
        for j in range(columns):
            p = position[j]
            v = kicked(velocity[j], keep, h, acceleration[j])
            out[j] = predicted(p, h, v) if weights[j] > zero else p

    @row
    def copy(columns, source, out):
        for j in range(columns):
            out[j] = source[j]

    @row
    def move(columns, position, way, weights, row_share, shares, record, out):
        matching = record[X_MATCHING]
        for j in range(columns):
            new = moved(position[j], row_share, shares[j], matching, way[j])
            out[j] = new if weights[j] > zero else position[j]

    @row
    def rate(columns, position, before, weights, record, out):
        inverse = record[X_INVERSE_SUBSTEP]
        for j in range(columns):
            v = rate_of(position[j], before[j], inverse)
            out[j] = v if weights[j] > zero else zero

    return SimpleNamespace(accelerate=accelerate, predict=predict, copy=copy, move=move, rate=rate)


def scratch_rows(region: int) -> int:
    """Rows of scratch of a band: the rings of positions and clusters, sums, ways and accelerations."""
    return (PLACE + GOAL) * (2 * region + 1) + SUMS + 2 * AXES
