"""Neighbour search among particles of bodies: cells of space, a counting sort, and the neighbours of each particle.

A cell is as large as the largest contact distance, so the 27 cells around a particle contain all its possible contacts.
Cells are stored in a table row by row along x, and particles are copied into the order of cells: the 27 cells are nine
runs of contiguous particles, processed LANES at a time. The table covers the box of all particles if it is large
enough. Otherwise cells that are a multiple of the table's size apart share an entry, and distances separate their
particles; the table is at least NARROWEST cells wide, so no two of the 27 share one. Neighbours are in the order of
cells, z, y, x, then of their numbers, for any table and number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from softlab.cpu_backend.contact.particles_cells import (
    AXES,
    BOX,
    cells_of,
    enter,
    put,
    runs_around,
    span,
    tally,
)
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.plain import in_python
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import routine, row_routine
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    MAX_NEIGHBOURS,
    PAIR_FIELDS,
    PAIRS,
)
from softlab.model.formulas.particle_contact import squared, within
from softlab.model.formulas.shape_matching.cluster import LANES

PLACES = 2 * AXES  # numbers of a sorted particle: its position, its rest position
RUN_INTEGERS = 64  # integers: begin and end of the runs around a band's cell, 27 at most

_built_in: Any = intrinsic  # typed by numba when it is compiled


@_built_in
def lowest_bit(typing_context, number):
    """Return the position of the lowest set bit of an int32; undefined for 0."""

    def build(context, builder, signature, arguments):
        place = builder.cttz(arguments[0], context.get_constant(types.boolean, True))
        return builder.zext(place, context.get_value_type(types.int64))

    return types.int64(types.int32), build


@in_python(lowest_bit)
def _lowest_bit(number: Any) -> int:
    return (int(number) & -int(number)).bit_length() - 1


@row_routine
def lanes_within(
    x, y, z, rest_x, rest_y, rest_z, body, search_radius, self_radius, rested, xs, ys, zs, rest_xs, rest_ys, rest_zs,
    bodies,
):  # fmt: skip
    """Return a mask of the LANES particles that may be neighbours, one bit each."""
    bits = np.int32(0)
    for lane in range(LANES):
        other = bodies[lane] != body
        close = within(squared(x - xs[lane], y - ys[lane], z - zs[lane]), search_radius if other else self_radius)
        beside = within(squared(rest_x - rest_xs[lane], rest_y - rest_ys[lane], rest_z - rest_zs[lane]), rested)
        bits |= np.int32(close & (other | (not beside))) << np.int32(lane)
    return bits


@routine
def search(band, first, last, rows, arrays):
    """Search the neighbours of the sorted particles `first` to before `last` and write the lists."""
    record, kind, buckets = rows.record, arrays.particles.kind, arrays.table.buckets
    order, places, bodies = arrays.in_order.order, arrays.in_order.places, arrays.in_order.bodies
    entries, pairs = arrays.lists.entries, arrays.lists.pairs
    runs = row_at(arrays.in_order.runs, np.int64(RUN_INTEGERS * band))
    n, entry, size = first, np.int64(first) * MAX_NEIGHBOURS, order.size
    cell, ends, missed = -1, 0, 0
    for q in range(first, last):
        i, body = order[q], bodies[q]
        if buckets[i] != cell:
            cell = buckets[i]
            ends = runs_around(np.int64(cell), arrays.table, runs)
        row = np.int64(PAIRS + PAIR_FIELDS * rows.kinds * kind[i])
        same = row + PAIR_FIELDS * kind[i]
        x, y, z = places[q], places[size + q], places[2 * size + q]
        rest_x, rest_y, rest_z = places[3 * size + q], places[4 * size + q], places[5 * size + q]
        self_radius, rested = record[same + G_SEARCH_RADIUS], record[same + G_NEIGHBOURS]
        if not record[same + G_SELF_DISTANCE] > 0:
            self_radius = 0.0
        neighbour_count = 0
        for run in range(0, ends, 2):
            end = runs[run + 1]
            for k in range(np.int64(runs[run]), end, LANES):
                near = lanes_within(
                    x, y, z, rest_x, rest_y, rest_z, body, rows.reach, self_radius, rested, row_at(places, k),
                    row_at(places, size + k), row_at(places, 2 * size + k), row_at(places, 3 * size + k),
                    row_at(places, 4 * size + k), row_at(places, 5 * size + k), row_at(bodies, k),
                )  # fmt: skip
                near &= np.int32((1 << min(LANES, end - k)) - 1)
                while near != 0:
                    at = k + lowest_bit(near)
                    near &= near - np.int32(1)
                    j = order[at]
                    pair, same_body = row + PAIR_FIELDS * kind[j], bodies[at] == body
                    if not same_body and record[pair + G_DISTANCE] <= 0:
                        continue
                    square = squared(x - places[at], y - places[size + at], z - places[2 * size + at])
                    if not within(square, record[pair + G_SEARCH_RADIUS]):
                        continue
                    if neighbour_count < MAX_NEIGHBOURS:
                        entries[entry], pairs[entry] = j, -1 - pair if same_body else pair
                        entry += 1
                    else:
                        missed += 1
                    neighbour_count += 1
        if neighbour_count > 0:
            arrays.lists.who[n], arrays.lists.numbers[n] = i, min(neighbour_count, MAX_NEIGHBOURS)
            n += 1
    arrays.lists.active[band] = n - first
    arrays.lists.lost[band] += missed


@routine
def find_all(team, member, bands, position, weights, rows, arrays):
    """Search all neighbours; each member of a team runs it (core/progress.py). `rows`: PairRows; `arrays`: Search."""
    count, table = weights.size, arrays.table
    cells, starts, totals, counts = table.cells, table.starts, table.totals, table.counts
    for band in assigned(team, member, bands):
        k, n = np.int64(count * band // bands), count * (band + 1) // bands - count * band // bands
        cells_of(
            n, row_at(weights, k), row_at(position, k), row_at(position, count + k), row_at(position, 2 * count + k),
            rows.record, row_at(cells, k), row_at(cells, count + k), row_at(cells, 2 * count + k),
            row_at(table.boxes, np.int64(BOX * band)), row_at(table.boxes, np.int64(BOX * band + AXES)),
        )  # fmt: skip
    for _ in assigned(team, member, 1):
        span(bands, starts.size - 1, table)
    for band in assigned(team, member, bands):
        k, last = np.int64(count * band // bands), count * (band + 1) // bands
        enter(k, last, count, table)
    for band in assigned(team, member, bands):
        size = counts[0] * counts[1] * counts[2]
        totals[band] = tally(size * band // bands, size * (band + 1) // bands, table.buckets, starts)
    for band in assigned(team, member, bands):
        size, end = counts[0] * counts[1] * counts[2], 0
        for earlier in range(band):
            end += totals[earlier]
        low, high = size * band // bands, size * (band + 1) // bands
        put(low, high, end, count, position, arrays)
        if band == bands - 1:
            starts[size] = end + totals[band]
    for band in assigned(team, member, bands):
        live = starts[counts[0] * counts[1] * counts[2]]
        arrays.lists.begins[band] = live * band // bands
        search(band, live * band // bands, live * (band + 1) // bands, rows, arrays)


@cache
def make_find_stage(real: Real, math: str) -> Callable:
    """Compile find(bands, position, weights, rows, arrays): see `find_all`."""
    compiler = Compiler(f"particles_{np.dtype(real).name}_{math}", math)
    return compiler.team(compiler.variant_of(real)(find_all))
