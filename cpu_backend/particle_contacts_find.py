"""Which particles of bodies may meet within a substep: cells of space, sorted by counting, and each particle's neighbours.

A cell is as large as the longest reach, so that the 27 around a particle hold all whom it may meet. Cells lie in a table
row by row along x, and particles are copied into the cells' order: the 27 are nine runs of particles that lie side by side,
looked at LANES at a time. The table holds the box of all particles where it is large enough, else cells a whole number of
tables apart share a place, and distances tell them apart; at least MOST_NARROW cells wide, so that no two of the 27 do.
Neighbours come in the order of cells, z, y, x, then of their numbers, whatever the table and the number of threads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from cpu_backend.layout import row_at
from model.formulas import particle_contact
from model.formulas.cluster import LANES
from model.particle_contact_record import (
    G_DISTANCE,
    G_NEIGHBOURS,
    G_OWN,
    G_REACH,
    H_INVERSE_CELL,
    MOST_NEIGHBOURS,
    PAIR_FIELDS,
    PAIRS,
)

AXES = 3
MOST_NARROW = 4  # cells two apart, which rounding may bring within reach, are none of the three side by side
PLACES = 2 * AXES  # numbers of a sorted particle: where it is, where it lay at rest
BOX = 2 * AXES  # numbers of a band's box of cells, and of the table's: the lowest cell, how many each way
RUNS = 27  # of sorted particles around a cell at most: nine, but where the table wraps
GATHERED = 512  # candidates of a cell that are put side by side; of more, which is a clump, runs are looked at in place
ROOM = LANES * 5  # whole numbers: LANES of them, and the runs' ends
WHOLE_SCRATCH, SCRATCH = ROOM + 2 * (GATHERED + LANES), PLACES * (GATHERED + LANES)  # of a band, whole and real numbers
FAR = np.int32(2**31 - 1)


def _make_table(compiler: Compiler, real: Any) -> SimpleNamespace:
    """`cells_of`, `span`, `enter`: from positions to places in the table."""
    scaled = particle_contact.make(real, compiler.compiled).scaled
    zero = real(0)

    @compiler.row
    def cells_of(n, weights, x, y, z, record, cell_x, cell_y, cell_z, box):
        """The cells of n particles, and the box of those that weigh anything."""
        inverse = record[H_INVERSE_CELL]
        low_x, low_y, low_z, high_x, high_y, high_z = FAR, FAR, FAR, -FAR, -FAR, -FAR
        for k in range(n):
            a, b, c = scaled(x[k], inverse), scaled(y[k], inverse), scaled(z[k], inverse)
            i, j, l = np.int32(a), np.int32(b), np.int32(c)  # noqa: E741
            i = np.int32(i - 1) if a < real(i) else i
            j = np.int32(j - 1) if b < real(j) else j
            l = np.int32(l - 1) if c < real(l) else l  # noqa: E741
            cell_x[k], cell_y[k], cell_z[k] = i, j, l
            there = weights[k] != zero
            low_x, high_x = min(low_x, i if there else FAR), max(high_x, i if there else -FAR)
            low_y, high_y = min(low_y, j if there else FAR), max(high_y, j if there else -FAR)
            low_z, high_z = min(low_z, l if there else FAR), max(high_z, l if there else -FAR)
        box[0], box[1], box[2], box[3], box[4], box[5] = low_x, low_y, low_z, high_x, high_y, high_z

    @compiler.compiled
    def span(bands, boxes, most, table):
        """The table of at most `most` cells that holds the boxes of all bands and a cell around; returned: whether it does, or is
        but as large as it may be."""
        holds = True
        for axis in range(AXES):
            low, high = np.int64(FAR), -np.int64(FAR)
            for band in range(bands):
                low, high = min(low, boxes[BOX * band + axis]), max(high, boxes[BOX * band + AXES + axis])
            table[axis], table[AXES + axis] = low - 1, max(high - low + 3, MOST_NARROW)
        while table[3] > most or table[4] > most or table[3] * table[4] > most or table[3] * table[4] * table[5] > most:
            widest, holds = 3, False
            for axis in (4, 5):
                if table[axis] > table[widest]:
                    widest = axis
            table[widest] = max(MOST_NARROW, (table[widest] + 1) // 2)
        return holds

    @compiler.compiled
    def within_table(cell, low, size):
        place = np.int64(cell) - low
        return place if 0 <= place < size else place - size * (place // size)

    @compiler.row
    def enter_rows(n, weights, cell_x, cell_y, cell_z, low_x, low_y, low_z, width, height, buckets):
        for k in range(n):
            place = ((cell_z[k] - low_z) * height + (cell_y[k] - low_y)) * width + (cell_x[k] - low_x)
            buckets[k] = place if weights[k] != zero else np.int32(-1)

    @compiler.compiled
    def enter(first, last, count, weights, cells, table, holds, buckets):
        """The places of the particles' cells in the table, -1 of those that weigh nothing. `holds`: whether it has all."""
        if holds:
            enter_rows(
                last - first, row_at(weights, first), row_at(cells, first), row_at(cells, count + first),
                row_at(cells, 2 * count + first), np.int32(table[0]), np.int32(table[1]), np.int32(table[2]),
                np.int32(table[3]), np.int32(table[4]), row_at(buckets, first),
            )  # fmt: skip
            return
        for k in range(first, last):
            x = within_table(cells[k], table[0], table[3])
            y = within_table(cells[count + k], table[1], table[4])
            z = within_table(cells[2 * count + k], table[2], table[5])
            buckets[k] = np.int32((z * table[4] + y) * table[3] + x) if weights[k] != zero else np.int32(-1)

    return SimpleNamespace(cells_of=cells_of, span=span, enter=enter)


def _make_sort(compiler: Compiler) -> SimpleNamespace:
    """`tally` and `put`: a counting sort that keeps the order, of the cells `low` to before `high` of the table."""

    @compiler.compiled
    def tally(low, high, buckets, starts):
        """How many particles each of the cells holds; returned: all of them."""
        inside = 0
        for b in range(low, high):
            starts[b] = 0
        for k in range(buckets.size):
            b = buckets[k]
            if low <= b < high:
                starts[b] += 1
                inside += 1
        return inside

    @compiler.compiled
    def put(low, high, end, count, buckets, starts, position, rest, body, order, places, bodies):
        """`end`: how many particles are in the cells before. Afterwards starts[b] is the first of cell b."""
        room = order.size
        for b in range(low, high):
            end += starts[b]
            starts[b] = end
        for n in range(count):
            k = count - 1 - n
            b = buckets[k]
            if low <= b < high:
                starts[b] -= 1
                q = starts[b]
                order[q], bodies[q] = k, body[k]
                for axis in range(AXES):
                    places[axis * room + q] = position[axis * count + k]
                    places[(AXES + axis) * room + q] = rest[axis * count + k]

    return SimpleNamespace(tally=tally, put=put)


def _make_looks(compiler: Compiler, real: Any) -> SimpleNamespace:
    """`look_others` and `look_all`, at LANES particles; `copy`, of places, bodies and numbers of n particles, whole LANES."""
    formulas = particle_contact.make(real, compiler.compiled)
    squared, within = formulas.squared, formulas.within

    @compiler.row
    def look_others(x, y, z, body, reach, k, size, places, all_bodies, near):
        """Whether each of those from k on may be a neighbour, of another body, into `near`; returned: whether any is."""
        xs, ys, zs = row_at(places, k), row_at(places, size + k), row_at(places, 2 * size + k)
        bodies, found = row_at(all_bodies, k), np.int32(0)
        for lane in range(LANES):
            close = within(squared(x - xs[lane], y - ys[lane], z - zs[lane]), reach)
            near[lane] = np.int32(close & (bodies[lane] != body))
            found |= near[lane]
        return found

    @compiler.row
    def look_all(x, y, z, rest_x, rest_y, rest_z, body, reach, rested, k, size, places, all_bodies, near):
        """The same, of the own body, too, but for those that lay beside it at rest."""
        xs, ys, zs = row_at(places, k), row_at(places, size + k), row_at(places, 2 * size + k)
        rest_xs, rest_ys = row_at(places, 3 * size + k), row_at(places, 4 * size + k)
        rest_zs, bodies, found = row_at(places, 5 * size + k), row_at(all_bodies, k), np.int32(0)
        for lane in range(LANES):
            close = within(squared(x - xs[lane], y - ys[lane], z - zs[lane]), reach)
            beside = within(squared(rest_x - rest_xs[lane], rest_y - rest_ys[lane], rest_z - rest_zs[lane]), rested)
            near[lane] = np.int32(close & ((bodies[lane] != body) | (not beside)))
            found |= near[lane]
        return found

    @compiler.row
    def copy(n, k, size, order, places, bodies, at, room, near_order, near_places, near_bodies):
        """n particles from k on, whole LANES, to `at`."""
        for block in range(0, n, LANES):
            for plane in range(PLACES):
                here, there = row_at(places, plane * size + k + block), row_at(near_places, plane * room + at + block)
                for lane in range(LANES):
                    there[lane] = here[lane]
            one, other = row_at(bodies, k + block), row_at(near_bodies, at + block)
            number, other_number = row_at(order, k + block), row_at(near_order, at + block)
            for lane in range(LANES):
                other[lane] = one[lane]
                other_number[lane] = number[lane]

    return SimpleNamespace(look_others=look_others, look_all=look_all, copy=copy)


def _make_around(compiler: Compiler, real: Any) -> Any:
    """gather(b, table, holds, starts, ...) -> (runs, candidates): who is in the 27 cells around cell b, where
    they begin and end; put `aside`, one after the other, if they are GATHERED at most: then it is one run."""
    copy = _make_looks(compiler, real).copy

    @compiler.compiled
    def runs_held(b, table, starts, runs):
        """In a table that holds all with a cell around."""
        width, layer, n, total = table[3], table[3] * table[4], 0, 0
        for dz in range(-1, 2):
            for dy in range(-1, 2):
                cell = b + dz * layer + dy * width
                runs[n], runs[n + 1] = starts[cell - 1], starts[cell + 2]
                total += runs[n + 1] - runs[n]
                n += 2 if runs[n + 1] > runs[n] else 0
        return n, total

    @compiler.compiled
    def runs_wrapped(b, table, starts, runs):
        width, height, depth = table[3], table[4], table[5]
        x, y, z, n, total = b % width, b // width % height, b // (width * height), 0, 0
        for place in range(27):
            row = (z + place // 9 - 1 + depth) % depth * height + (y + place // 3 % 3 - 1 + height) % height
            cell = row * width + (x + place % 3 - 1 + width) % width
            runs[n], runs[n + 1] = starts[cell], starts[cell + 1]
            total += runs[n + 1] - runs[n]
            n += 2 if runs[n + 1] > runs[n] else 0
        return n, total

    @compiler.compiled
    def gather(b, table, holds, starts, order, places, bodies, near_order, near_places, near_bodies, runs):
        if holds:
            count, total = runs_held(b, table, starts, runs)
        else:
            count, total = runs_wrapped(b, table, starts, runs)
        if total > GATHERED:
            return count, total
        size, room, at = order.size, np.int64(GATHERED + LANES), np.int64(0)
        for run in range(0, count, 2):
            k, n = np.int64(runs[run]), runs[run + 1] - runs[run]
            copy(n, k, size, order, places, bodies, at, room, near_order, near_places, near_bodies)
            at += n
        runs[0], runs[1] = 0, total
        return 2, total

    return gather


def _make_search(compiler: Compiler, real: Any) -> Any:
    """search(band, first, last, ...): see the inner function."""
    formulas, looks = particle_contact.make(real, compiler.compiled), _make_looks(compiler, real)
    squared, within = formulas.squared, formulas.within
    look_others, look_all, gather = looks.look_others, looks.look_all, _make_around(compiler, real)

    @compiler.compiled
    def mixed(n, bodies, body):
        """Whether any of n particles is of another body."""
        found = np.int32(0)
        for k in range(n):
            found |= bodies[k] ^ body
        return found != 0

    @compiler.compiled
    def search(
        band, first, last, record, reach, kinds, kind, table, holds, buckets, starts, all_order, all_places, all_bodies,
        room, aside, who, numbers, entries, pairs, active, lost,
    ):  # fmt: skip
        """The neighbours of the sorted particles `first` to before `last`. Those that have any are put into `who` from
        there on, `numbers`: how many; the neighbours lie in `entries`, one particle's after the other's, from MOST_NEIGHBOURS
        times `first` on; `pairs`: where in the record their constants are, -1 less that of one within a body. `active`: how
        many have any."""
        n, entry, count = first, np.int64(first) * MOST_NEIGHBOURS, all_order.size
        near, runs = row_at(room, np.int64(0)), row_at(room, np.int64(LANES))
        near_bodies, near_order = row_at(room, np.int64(ROOM)), row_at(room, np.int64(ROOM + GATHERED + LANES))
        order, places, bodies, size = near_order, aside, near_bodies, np.int64(GATHERED + LANES)
        cell, ends, missed, alone = -1, 0, 0, False
        for q in range(first, last):
            i, body = all_order[q], all_bodies[q]
            if buckets[i] != cell:
                cell = buckets[i]
                ends, total = gather(
                    np.int64(cell), table, holds, starts, all_order, all_places, all_bodies, near_order, aside, near_bodies, runs
                )
                if total <= GATHERED:
                    order, places, bodies, size = near_order, aside, near_bodies, np.int64(GATHERED + LANES)
                    alone = not mixed(total, near_bodies, body)
                else:
                    order, places, bodies, size, alone = all_order, all_places, all_bodies, np.int64(count), False
            row = np.int64(PAIRS + PAIR_FIELDS * kinds * kind[i])
            same = row + PAIR_FIELDS * kind[i]
            rested, own = record[same + G_NEIGHBOURS], record[same + G_OWN] > 0
            if alone and not own:
                continue
            x, y, z = all_places[q], all_places[count + q], all_places[2 * count + q]
            rest_x, rest_y, rest_z = all_places[3 * count + q], all_places[4 * count + q], all_places[5 * count + q]
            found = 0
            for run in range(0, ends, 2):
                end = runs[run + 1]
                for k in range(np.int64(runs[run]), end, LANES):
                    if own:
                        any_near = look_all(
                            x, y, z, rest_x, rest_y, rest_z, body, reach, rested, k, size, places, bodies, near
                        )
                    else:
                        any_near = look_others(x, y, z, body, reach, k, size, places, bodies, near)
                    if any_near == 0:
                        continue
                    for lane in range(min(LANES, end - k)):
                        if near[lane] == 0:
                            continue
                        j = order[k + lane]
                        pair, mine = row + PAIR_FIELDS * kind[j], bodies[k + lane] == body
                        if not mine and record[pair + G_DISTANCE] <= 0:
                            continue
                        square = squared(x - places[k + lane], y - places[size + k + lane], z - places[2 * size + k + lane])
                        if not within(square, record[pair + G_REACH]):
                            continue
                        if found < MOST_NEIGHBOURS:
                            entries[entry], pairs[entry] = j, -1 - pair if mine else pair
                            entry += 1
                        else:
                            missed += 1
                        found += 1
            if found > 0:
                who[n], numbers[n] = i, min(found, MOST_NEIGHBOURS)
                n += 1
        active[band], lost[band] = n - first, lost[band] + missed

    return search


@cache
def make_find(real: Any, math: str) -> Any:
    """find(bands, position, weights, record, reach, kinds, of_particle, tables, sorted, neighbours): arrays as
    cpu_backend/particle_contacts.py makes them."""
    compiler = Compiler(f"particles_{np.dtype(real).name}_{math}", math)
    table_made, sort = _make_table(compiler, real), _make_sort(compiler)
    cells_of, span, enter = table_made.cells_of, table_made.span, table_made.enter
    tally, put, search = sort.tally, sort.put, _make_search(compiler, real)

    def find(bands, position, weights, record, reach, kinds, of_particle, tables, in_order, neighbours):
        body, kind, rest = of_particle
        cells, boxes, table, buckets, starts, totals = tables
        order, places, bodies, rooms, asides = in_order
        who, numbers, entries, pairs, begins, active, lost = neighbours
        count = weights.size
        for band in prange(bands):
            k, n = np.int64(count * band // bands), count * (band + 1) // bands - count * band // bands
            cells_of(
                n, row_at(weights, k), row_at(position, k), row_at(position, count + k), row_at(position, 2 * count + k),
                record, row_at(cells, k), row_at(cells, count + k), row_at(cells, 2 * count + k),
                row_at(boxes, np.int64(BOX * band)),
            )  # fmt: skip
        holds = span(bands, boxes, starts.size - 1, table)
        size = table[3] * table[4] * table[5]
        for band in prange(bands):
            enter(
                np.int64(count * band // bands), count * (band + 1) // bands, count, weights, cells, table, holds, buckets
            )
        for band in prange(bands):
            totals[band] = tally(size * band // bands, size * (band + 1) // bands, buckets, starts)
        for band in prange(bands):
            end = 0
            for earlier in range(band):
                end += totals[earlier]
            low, high = size * band // bands, size * (band + 1) // bands
            put(low, high, end, count, buckets, starts, position, rest, body, order, places, bodies)
        live = np.int64(0)
        for band in range(bands):
            live += totals[band]
        starts[size] = live
        for band in prange(bands):
            begins[band] = live * band // bands
            search(
                band, live * band // bands, live * (band + 1) // bands, record, reach, kinds, kind, table, holds, buckets, starts,
                order, places, bodies, row_at(rooms, np.int64(WHOLE_SCRATCH * band)),
                row_at(asides, np.int64(SCRATCH * band)), who, numbers, entries, pairs, active, lost,
            )  # fmt: skip

    return compiler.kernel(find)
