"""Which particles of bodies may meet within a substep: cells of space, sorted by counting, and each particle's neighbours.

A cell is as large as the longest reach, so that the 27 around a particle hold all whom it may meet. Cells lie in a table
row by row along x, and particles are copied into the cells' order: the 27 are nine runs of particles that lie side by side,
looked at LANES at a time. The table holds the box of all particles where it is large enough, else cells a whole number of
tables apart share a place, and distances tell them apart; it is NARROWEST cells wide at least, so that no two of 27 do.
Neighbours come in the order of cells, z, y, x, then of their numbers, whatever the table and the number of threads.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from cpu_backend.contact.particles_cells import AXES, BOX, make_runs, make_sort, make_table
from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from cpu_backend.core.plain import in_python
from cpu_backend.core.progress import shares
from model.contact.particle_parameters import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_OWN,
    G_REACH,
    MAX_NEIGHBOURS,
    PAIR_FIELDS,
    PAIRS,
)
from model.formulas import particle_contact
from model.formulas.shape_matching.cluster import LANES

PLACES = 2 * AXES  # numbers of a sorted particle: where it is, where it lay at rest
HOLDS = BOX  # of the table's only: whether it holds all cells that there are
TABLE = BOX + 1
ROOM = 64  # whole numbers: where the runs of a band's cell begin and end, 27 at most

_built_in: Any = intrinsic  # typed by numba when it is compiled


@_built_in
def lowest_bit(typing_context, number):
    """Where the lowest bit of an int32 that is set lies; of 0 there is none."""

    def build(context, builder, signature, arguments):
        place = builder.cttz(arguments[0], context.get_constant(types.boolean, True))
        return builder.zext(place, context.get_value_type(types.int64))

    return types.int64(types.int32), build


@in_python(lowest_bit)
def _lowest_bit(number: Any) -> int:
    return (int(number) & -int(number)).bit_length() - 1


def _make_search(compiler: Compiler, real: Any) -> Any:
    """search(band, first, last, ...): see the inner function."""
    formulas, runs_around = particle_contact.make(real, compiler.compiled), make_runs(compiler)
    squared, within = formulas.squared, formulas.within
    zero = real(0)

    @compiler.row
    def look(x, y, z, rest_x, rest_y, rest_z, body, reach, own, rested, xs, ys, zs, rest_xs, rest_ys, rest_zs, bodies):
        """Which of LANES particles may be neighbours, a bit each."""
        found = np.int32(0)
        for lane in range(LANES):
            other = bodies[lane] != body
            close = within(squared(x - xs[lane], y - ys[lane], z - zs[lane]), reach if other else own)
            beside = within(squared(rest_x - rest_xs[lane], rest_y - rest_ys[lane], rest_z - rest_zs[lane]), rested)
            found |= np.int32(close & (other | (not beside))) << np.int32(lane)
        return found

    @compiler.compiled
    def search(
        band, first, last, record, reach, kinds, kind, table, holds, buckets, starts, order, places, bodies, runs, who,
        numbers, entries, pairs, active, lost,
    ):  # fmt: skip
        """The neighbours of the sorted particles `first` to before `last`. Those that have any are put into `who` from
        there on, `numbers`: how many; the neighbours lie in `entries`, one particle's after the other's, from MAX_NEIGHBOURS
        times `first` on; `pairs`: where in the record their constants are, -1 less that of one within a body. `active`: how
        many have any."""
        n, entry, size = first, np.int64(first) * MAX_NEIGHBOURS, order.size
        cell, ends, missed = -1, 0, 0
        for q in range(first, last):
            i, body = order[q], bodies[q]
            if buckets[i] != cell:
                cell = buckets[i]
                ends = runs_around(np.int64(cell), table, holds, starts, runs)
            row = np.int64(PAIRS + PAIR_FIELDS * kinds * kind[i])
            same = row + PAIR_FIELDS * kind[i]
            x, y, z = places[q], places[size + q], places[2 * size + q]
            rest_x, rest_y, rest_z = places[3 * size + q], places[4 * size + q], places[5 * size + q]
            own, rested = record[same + G_REACH], record[same + G_NEIGHBOURS]
            if not record[same + G_OWN] > 0:
                own = zero
            found = 0
            for run in range(0, ends, 2):
                end = runs[run + 1]
                for k in range(np.int64(runs[run]), end, LANES):
                    near = look(
                        x, y, z, rest_x, rest_y, rest_z, body, reach, own, rested, row_at(places, k),
                        row_at(places, size + k), row_at(places, 2 * size + k), row_at(places, 3 * size + k),
                        row_at(places, 4 * size + k), row_at(places, 5 * size + k), row_at(bodies, k),
                    )  # fmt: skip
                    near &= np.int32((1 << min(LANES, end - k)) - 1)
                    while near != 0:
                        at = k + lowest_bit(near)
                        near &= near - np.int32(1)
                        j = order[at]
                        pair, mine = row + PAIR_FIELDS * kind[j], bodies[at] == body
                        if not mine and record[pair + G_DISTANCE] <= 0:
                            continue
                        square = squared(x - places[at], y - places[size + at], z - places[2 * size + at])
                        if not within(square, record[pair + G_REACH]):
                            continue
                        if found < MAX_NEIGHBOURS:
                            entries[entry], pairs[entry] = j, -1 - pair if mine else pair
                            entry += 1
                        else:
                            missed += 1
                        found += 1
            if found > 0:
                who[n], numbers[n] = i, min(found, MAX_NEIGHBOURS)
                n += 1
        active[band], lost[band] = n - first, lost[band] + missed

    return search


@cache
def make_find(real: Any, math: str) -> Any:
    """find(team, member, bands, position, weights, record, reach, kinds, of_particle, tables, in_order, neighbours): what a
    member of a team does (core/progress.py); arrays as cpu_backend/contact/particles.py makes them."""
    compiler = Compiler(f"particles_find_{np.dtype(real).name}_{math}", math)
    table_made, sort = make_table(compiler, real), make_sort(compiler)
    cells_of, span, enter = table_made.cells_of, table_made.span, table_made.enter
    tally, put, search = sort.tally, sort.put, _make_search(compiler, real)

    @compiler.compiled
    def find_all(
        team, member, bands, position, weights, record, reach, kinds, of_particle, tables, in_order, neighbours
    ):  # fmt: skip
        body, kind, rest = of_particle
        cells, boxes, table, buckets, starts, totals = tables
        order, places, bodies, rooms = in_order
        who, numbers, entries, pairs, begins, active, lost = neighbours
        count = weights.size
        for band in shares(team, member, bands):
            k, n = np.int64(count * band // bands), count * (band + 1) // bands - count * band // bands
            cells_of(
                n, row_at(weights, k), row_at(position, k), row_at(position, count + k), row_at(position, 2 * count + k),
                record, row_at(cells, k), row_at(cells, count + k), row_at(cells, 2 * count + k),
                row_at(boxes, np.int64(BOX * band)),
            )  # fmt: skip
        for _ in shares(team, member, 1):
            table[HOLDS] = span(bands, boxes, starts.size - 1, table)
        for band in shares(team, member, bands):
            k, last = np.int64(count * band // bands), count * (band + 1) // bands
            enter(k, last, count, cells, table, table[HOLDS] != 0, buckets)
        for band in shares(team, member, bands):
            size = table[3] * table[4] * table[5]
            totals[band] = tally(size * band // bands, size * (band + 1) // bands, buckets, starts)
        for band in shares(team, member, bands):
            size, end = table[3] * table[4] * table[5], 0
            for earlier in range(band):
                end += totals[earlier]
            low, high = size * band // bands, size * (band + 1) // bands
            put(low, high, end, count, buckets, starts, position, rest, body, order, places, bodies)
            if band == bands - 1:
                starts[size] = end + totals[band]
        for band in shares(team, member, bands):
            live = starts[table[3] * table[4] * table[5]]
            begins[band] = live * band // bands
            search(
                band, live * band // bands, live * (band + 1) // bands, record, reach, kinds, kind, table, table[HOLDS] != 0,
                buckets, starts, order, places, bodies, row_at(rooms, np.int64(ROOM * band)), who, numbers, entries, pairs,
                active, lost,
            )  # fmt: skip

    return find_all


@cache
def make_find_stage(real: Any, math: str) -> Any:
    """find(bands, position, weights, record, reach, kinds, of_particle, tables, in_order, neighbours): see make_find."""
    find_all = make_find(real, math)

    return Compiler(f"particles_{np.dtype(real).name}_{math}", math).team(find_all)
