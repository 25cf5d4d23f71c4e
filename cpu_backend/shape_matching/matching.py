"""Shape matching of a grid on CPU threads, a whole iteration in one pass; matching_stages.py has its two stages.

Each thread goes down a band of rows once per iteration, a row of predictions, a row of clusters and a row of masses at
a time; the rows between are stored in a ring that fits in the first-level cache. Rows beyond a band that its windows
cover are computed by both neighbours: no thread waits for another. In `exact` math both give the same bits, for any
number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.matching_rows import (
    CLUSTER,
    GOALS,
    LINE,
    SUMS,
    accelerate,
    add_goals,
    add_window,
    clear,
    copy,
    finish,
    move,
    predict,
    rate,
    sum_goals,
    sum_line,
    window,
)
from softlab.model.assets.lattice import T_CENTRE, T_INVERSE, T_WEIGHT
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, filled, open_constant, real, routine
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas.shape_matching.grid import rest_offset

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


# rows of a band's scratch (`scratch_places`)
RING = open_constant("RING: rows of a ring; the first ones are positions")
AT_CLUSTERS = open_constant("AT_CLUSTERS: first row of the ring of clusters")
AT_SUMS = open_constant("AT_SUMS: first row of the sums of windows")
AT_DISPLACEMENTS = open_constant("AT_DISPLACEMENTS: first row of the displacements")
AT_KICK = open_constant("AT_KICK: first row of the accelerations")


def scratch_places(region: int) -> dict[str, int]:
    """Return the rows of a band's scratch by their open names, and COUNT, their number."""
    ring = 2 * region + 1
    sums = (PLACE + GOAL) * ring
    displacements, kick = sums + SUMS, sums + SUMS + AXES
    return {
        "RING": ring, "AT_CLUSTERS": PLACE * ring, "AT_SUMS": sums, "AT_DISPLACEMENTS": displacements, "AT_KICK": kick,
        "COUNT": kick + AXES,
    }  # fmt: skip


@routine
def bring(far, step, predicting, grid, begin, before, rows_scratch):
    """Write the positions of row `far`, predicted or from the last iteration, and their sums into the ring."""
    rows, columns, stride = grid.rows, grid.columns, grid.stride
    kick = row_at(rows_scratch, AT_KICK * stride)
    if predicting:
        accelerate(far, step, columns, stride, grid.parameters, grid.integers, kick)
    for axis in range(AXES):
        into = row_at(rows_scratch, (PLACE * (far % RING) + axis) * stride)
        place = (axis * rows + far) * stride
        if predicting:
            predict(
                columns, row_at(begin, place), row_at(begin, place + AXES * rows * stride), row_at(kick, axis * stride),
                row_at(grid.weights, far * stride), grid.parameters, into,
            )  # fmt: skip
        else:
            copy(columns, row_at(before, place), into)
    x = row_at(rows_scratch, PLACE * (far % RING) * stride)
    sum_line(columns, stride, x, row_at(x, stride), grid.column_table, row_at(x, AXES * stride))


@routine
def match(i, grid, rows_scratch):
    """Write the clusters of row i and their sums into their ring."""
    columns, stride, row_table, table = grid.columns, grid.stride, grid.row_table, grid.column_table
    sums = row_at(rows_scratch, AT_SUMS * stride)
    clear(SUMS * stride, sums)
    here = row_at(rows_scratch, PLACE * (i % RING) * stride)
    first, last = window(i, grid.rows)
    for other in range(first, last):
        offset = real(other - i) - row_table[T_CENTRE, i]
        x = row_at(rows_scratch, PLACE * (other % RING) * stride)
        add_window(
            columns, stride, row_at(x, AXES * stride), x, here, table, row_table[T_WEIGHT, other], offset, sums,
        )  # fmt: skip
    cluster = row_at(rows_scratch, (AT_CLUSTERS + GOAL * (i % RING)) * stride)
    finish(columns, stride, sums, here, row_at(here, stride), row_table[T_INVERSE, i], table, cluster)
    sum_goals(columns, stride, cluster, table, grid.parameters.matching_rest, row_at(cluster, CLUSTER * stride))


@routine
def arrive(i, ending, grid, begin, after, rows_scratch):
    """Move the masses of row i towards their goals; at a substep's end also compute their velocities."""
    rows, columns, stride = grid.rows, grid.columns, grid.stride
    row_table, table, parameters = grid.row_table, grid.column_table, grid.parameters
    displacements, rest = row_at(rows_scratch, AT_DISPLACEMENTS * stride), parameters.matching_rest
    clear(AXES * stride, displacements)
    here = row_at(rows_scratch, PLACE * (i % RING) * stride)
    first, last = window(i, grid.rows)
    for other in range(first, last):
        down = rest_offset(real(i - other), row_table[T_CENTRE, other], rest)
        cluster = row_at(rows_scratch, (AT_CLUSTERS + GOAL * (other % RING)) * stride)
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


@routine
def down_band(first, last, kind, step, grid, begin, before, after, rows_scratch):
    """Do one iteration of the rows first to before last.

    From the positions `before`, or in a first iteration from the state `begin`, to those of `after`; in a last one
    also to its velocities.
    """
    for far in range(max(0, first - 2 * FEATURE.region), last + 2 * FEATURE.region):
        if far < grid.rows:
            predicting = kind in (ONCE, FIRST)
            bring(far, step, predicting, grid, begin, before, rows_scratch)
        near = far - FEATURE.region
        if 0 <= near < grid.rows and first - FEATURE.region <= near < last + FEATURE.region:
            match(near, grid, rows_scratch)
        i = near - FEATURE.region
        if first <= i < last:
            ending = kind in (ONCE, LAST)
            arrive(i, ending, grid, begin, after, rows_scratch)


@routine
def advance(team, member, bands, steps, grid, states, current, scratch, rows_scratch, place_after):
    """Advance the band's rows by `steps.steps` steps."""
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


@cache
def make_matching_advance(real: Real, math: str, region: int, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, grid, states, current, scratch, rows_scratch, place_after), `steps`: a Steps.

    `states`: flat, STATES of them, each four planes of `rows` rows `stride` apart; `current`: index of the state;
    `scratch`: flat, `rows_scratch` numbers per band; `place_after` (1,): index of the final state.
    """
    words = "_".join(sorted(parts))
    compiler = Compiler(f"matching_{np.dtype(real).name}_{math}_{region}_{words}", math)
    features = features_of(parts) | {"axes": AXES, "region": region, "particle_forces": bool(particle_forces(parts))}
    kernel = with_forces(filled(advance, scratch_places(region)), parts)
    return compiler.team(compiler.variant_of(real, features).copied(kernel))
