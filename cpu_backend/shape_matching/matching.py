"""Shape matching of a grid on CPU threads, a whole iteration in one pass; matching_stages.py has its two stages.

Each thread goes down a band of rows once per iteration, a row of predictions, a row of clusters and a row of masses at
a time; the rows between are stored in a ring that fits in the first-level cache. Rows beyond a band that its windows
cover are computed by both neighbours: no thread waits for another. In `exact` math both give the same bits, for any
number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.matching_rows import (
    CLUSTER,
    GOALS,
    LINE,
    SUMS,
    make_clear,
    make_cluster_rows,
    make_goal_rows,
    make_motion_rows,
)
from softlab.model.assets.lattice import T_CENTRE, T_INVERSE, T_WEIGHT
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import grid as shape_matching

AXES = 2
PLACE = AXES + LINE  # rows of a ring: of a row of masses ...
GOAL = CLUSTER + GOALS  # ... and of one of clusters
STATES = 3  # of a substep: its start, and two that iterations use in turn
ONCE, FIRST, MIDDLE, LAST = range(4)  # number of an iteration within a substep; ONCE: first and last


class Grid(NamedTuple):
    """A grid in bands of rows: the bands' first rows (bands + 1,); numbers of rows and columns, and of numbers between
    rows; tables (3, rows) and flat, rows `stride` apart; weights, flat, likewise, 0 if pinned; constants; integers of
    random forces."""

    bounds: np.ndarray
    rows: int
    columns: int
    stride: int
    row_table: np.ndarray
    column_table: np.ndarray
    weights: np.ndarray
    parameters: np.record
    integers: np.ndarray


def scratch_places(region: int) -> SimpleNamespace:
    """Return the rows of a band's scratch: the `ring` (its length) of positions, then those of `clusters`, `sums`,
    `displacements` and accelerations (`kick`); `count`: all."""
    ring = 2 * region + 1
    sums = (PLACE + GOAL) * ring
    displacements, kick = sums + SUMS, sums + SUMS + AXES
    return SimpleNamespace(
        ring=ring, clusters=PLACE * ring, sums=sums, displacements=displacements, kick=kick, count=kick + AXES
    )


def _make_window(compiler: Compiler, region: int) -> Callable:
    """Make window(i, rows): (first, behind the last) row of the window of row i."""

    @compiler.compiled
    def window(i, rows):
        return max(0, i - region), min(rows, i + region + 1)

    return window


def make_bring(compiler: Compiler, real: Real, region: int, parts: frozenset[str]) -> Callable:
    """Make bring: see the inner function."""
    motion, sum_line = make_motion_rows(compiler, real, parts), make_cluster_rows(compiler, real, region).sum_line
    accelerate, predict, copy = motion.accelerate, motion.predict, motion.copy
    places = scratch_places(region)
    ring, at_kick = places.ring, places.kick

    @compiler.compiled
    def bring(far, step, predicting, grid, begin, before, rows_scratch):
        """Write the positions of row `far`, predicted or from the last iteration, and their sums into the ring."""
        rows, columns, stride = grid.rows, grid.columns, grid.stride
        kick = row_at(rows_scratch, at_kick * stride)
        if predicting:
            accelerate(far, step, columns, stride, grid.parameters, grid.integers, kick)
        for axis in range(AXES):
            into = row_at(rows_scratch, (PLACE * (far % ring) + axis) * stride)
            place = (axis * rows + far) * stride
            if predicting:
                predict(
                    columns, row_at(begin, place), row_at(begin, place + AXES * rows * stride), row_at(kick, axis * stride),
                    row_at(grid.weights, far * stride), grid.parameters, into,
                )  # fmt: skip
            else:
                copy(columns, row_at(before, place), into)
        x = row_at(rows_scratch, PLACE * (far % ring) * stride)
        sum_line(columns, stride, x, row_at(x, stride), grid.column_table, row_at(x, AXES * stride))

    return bring


def make_match(compiler: Compiler, real: Real, region: int) -> Callable:
    """Make match: see the inner function."""
    rows_of, sum_goals = make_cluster_rows(compiler, real, region), make_goal_rows(compiler, real, region).sum_goals
    add_window, finish, clear = rows_of.add_window, rows_of.finish, make_clear(compiler, real)
    window, places = _make_window(compiler, region), scratch_places(region)
    ring, at_clusters, at_sums = places.ring, places.clusters, places.sums

    @compiler.compiled
    def match(i, grid, rows_scratch):
        """Write the clusters of row i and their sums into their ring."""
        columns, stride, row_table, table = grid.columns, grid.stride, grid.row_table, grid.column_table
        sums = row_at(rows_scratch, at_sums * stride)
        clear(SUMS * stride, sums)
        here = row_at(rows_scratch, PLACE * (i % ring) * stride)
        first, last = window(i, grid.rows)
        for other in range(first, last):
            offset = real(other - i) - row_table[T_CENTRE, i]
            x = row_at(rows_scratch, PLACE * (other % ring) * stride)
            add_window(
                columns, stride, row_at(x, AXES * stride), x, here, table, row_table[T_WEIGHT, other], offset, sums,
            )  # fmt: skip
        cluster = row_at(rows_scratch, (at_clusters + GOAL * (i % ring)) * stride)
        finish(columns, stride, sums, here, row_at(here, stride), row_table[T_INVERSE, i], table, cluster)
        sum_goals(columns, stride, cluster, table, grid.parameters.matching_rest, row_at(cluster, CLUSTER * stride))

    return match


def make_arrive(compiler: Compiler, real: Real, region: int, parts: frozenset[str]) -> Callable:
    """Make arrive: see the inner function."""
    motion, add_goals = make_motion_rows(compiler, real, parts), make_goal_rows(compiler, real, region).add_goals
    move, rate, clear = motion.move, motion.rate, make_clear(compiler, real)
    rest_offset = compiler.formulas(shape_matching, real).rest_offset
    window, places = _make_window(compiler, region), scratch_places(region)
    ring, at_clusters, at_displacements = places.ring, places.clusters, places.displacements

    @compiler.compiled
    def arrive(i, ending, grid, begin, after, rows_scratch):
        """Move the masses of row i towards their goals; at a substep's end also compute their velocities."""
        rows, columns, stride = grid.rows, grid.columns, grid.stride
        row_table, table, parameters = grid.row_table, grid.column_table, grid.parameters
        displacements, rest = row_at(rows_scratch, at_displacements * stride), parameters.matching_rest
        clear(AXES * stride, displacements)
        here = row_at(rows_scratch, PLACE * (i % ring) * stride)
        first, last = window(i, grid.rows)
        for other in range(first, last):
            down = rest_offset(real(i - other), row_table[T_CENTRE, other], rest)
            cluster = row_at(rows_scratch, (at_clusters + GOAL * (other % ring)) * stride)
            add_goals(
                columns, stride, row_at(cluster, CLUSTER * stride), cluster, here, row_at(here, stride), table, down,
                displacements, row_at(displacements, stride),
            )  # fmt: skip
        for axis in range(AXES):
            place = (axis * rows + i) * stride
            here_weights, out = row_at(grid.weights, i * stride), row_at(after, place)
            move(
                columns, row_at(here, axis * stride), row_at(displacements, axis * stride), here_weights,
                row_table[T_WEIGHT, i], table, parameters, out,
            )  # fmt: skip
            if ending:
                new = row_at(after, place + AXES * rows * stride)
                rate(columns, out, row_at(begin, place), here_weights, parameters, new)

    return arrive


@cache
def make_matching_advance(real: Real, math: str, region: int, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, grid, states, current, scratch, rows_scratch, place_after), `steps`: a Steps.

    `states`: flat, STATES of them, each four planes of `rows` rows `stride` apart; `current`: index of the state;
    `scratch`: flat, `rows_scratch` numbers per band; `place_after` (1,): index of the final state.
    """
    words = "_".join(sorted(parts))
    compiler = Compiler(f"matching_{np.dtype(real).name}_{math}_{region}_{words}", math)
    bring, match = make_bring(compiler, real, region, parts), make_match(compiler, real, region)
    arrive = make_arrive(compiler, real, region, parts)

    @compiler.compiled
    def down_band(first, last, kind, step, grid, begin, before, after, rows_scratch):
        """Do one iteration of the rows first to before last.

        From the positions `before`, or in a first iteration from the state `begin`, to those of `after`; in a last one
        also to its velocities.
        """
        for far in range(max(0, first - 2 * region), last + 2 * region):
            if far < grid.rows:
                predicting = kind in (ONCE, FIRST)
                bring(far, step, predicting, grid, begin, before, rows_scratch)
            near = far - region
            if 0 <= near < grid.rows and first - region <= near < last + region:
                match(near, grid, rows_scratch)
            i = near - region
            if first <= i < last:
                ending = kind in (ONCE, LAST)
                arrive(i, ending, grid, begin, after, rows_scratch)

    def advance(team, member, bands, steps, grid, states, current, scratch, rows_scratch, place_after):
        size, bounds = 2 * AXES * grid.rows * grid.stride, grid.bounds
        now, begin = current, current
        for place in range(steps.steps * steps.substeps):
            for iteration in range(steps.iterations):
                kind = MIDDLE
                if iteration == steps.iterations - 1:
                    kind = LAST if iteration > 0 else ONCE
                elif iteration == 0:
                    kind = FIRST
                after = (now + 1) % STATES
                if after == begin and iteration > 0:
                    after = (after + 1) % STATES
                for band in assigned(team, member, bands):
                    down_band(
                        bounds[band], bounds[band + 1], kind, steps.step + place // steps.substeps, grid,
                        row_at(states, begin * size), row_at(states, now * size), row_at(states, after * size),
                        row_at(scratch, band * rows_scratch),
                    )  # fmt: skip
                now = after
            begin = now
        if member == 0:
            place_after[0] = now

    return compiler.team(advance)
