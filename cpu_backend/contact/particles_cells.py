"""The table of cells for the neighbour search among particles of bodies (contact/particles_find.py): cells of
particles, the sort by cells, and the runs of particles around a cell."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.model.base.variant import real, routine, row_routine
from softlab.model.contact.particle_parameters import FARTHEST, H_INVERSE_CELL
from softlab.model.formulas.particle_contact import scaled

AXES = 3
NARROWEST = 4  # cells; of 3, one two cells away, which rounding may bring within range, would count as adjacent
BOX = 2 * AXES  # numbers of a band's box of cells: the lowest one, the highest one
FAR = np.int32(2**31 - 1)
LIMIT = float(FARTHEST)


@row_routine
def cells_of(n, weights, x, y, z, record, cell_x, cell_y, cell_z, low, high):
    """Write the cells of n particles (FAR without a weight or a finite position), and the box of the others."""
    inverse = record[H_INVERSE_CELL]
    low_x, low_y, low_z, high_x, high_y, high_z = FAR, FAR, FAR, -FAR, -FAR, -FAR
    for k in range(n):
        a, b, c = scaled(x[k], inverse), scaled(y[k], inverse), scaled(z[k], inverse)
        i, j, l = np.int32(a), np.int32(b), np.int32(c)  # noqa: E741
        i = np.int32(i - 1) if a < real(i) else i
        j = np.int32(j - 1) if b < real(j) else j
        l = np.int32(l - 1) if c < real(l) else l  # noqa: E741
        there = (weights[k] != 0.0) & (abs(a) <= LIMIT) & (abs(b) <= LIMIT) & (abs(c) <= LIMIT)  # false for NaN
        cell_x[k], cell_y[k], cell_z[k] = i if there else FAR, j, l
        low_x, high_x = min(low_x, i if there else FAR), max(high_x, i if there else -FAR)
        low_y, high_y = min(low_y, j if there else FAR), max(high_y, j if there else -FAR)
        low_z, high_z = min(low_z, l if there else FAR), max(high_z, l if there else -FAR)
    low[0], low[1], low[2], high[0], high[1], high[2] = low_x, low_y, low_z, high_x, high_y, high_z


@routine
def span(bands, most, table):
    """Set the table, of at most `most` cells, around the boxes of all bands and one cell more; it does not cover
    them if the limit made it smaller."""
    holds, boxes, counts = True, table.boxes, table.counts
    for axis in range(AXES):
        low, high = np.int64(FAR), -np.int64(FAR)
        for band in range(bands):
            low, high = min(low, boxes[BOX * band + axis]), max(high, boxes[BOX * band + AXES + axis])
        table.low[axis], counts[axis] = low - 1, max(high - low + 3, NARROWEST)
    while (
        counts[0] > most or counts[1] > most or counts[0] * counts[1] > most or counts[0] * counts[1] * counts[2] > most
    ):
        widest, holds = 0, False
        for axis in (1, 2):
            if counts[axis] > counts[widest]:
                widest = axis
        counts[widest] = max(NARROWEST, (counts[widest] + 1) // 2)
    table.holds[0] = holds


@routine
def within_table(cell, low, size):
    """Return the place of a cell along an axis of the table, which repeats."""
    place = np.int64(cell) - low
    return place if 0 <= place < size else place - size * (place // size)


@row_routine
def enter_rows(n, cell_x, cell_y, cell_z, low_x, low_y, low_z, width, height, buckets):
    for k in range(n):
        place = ((cell_z[k] - low_z) * height + (cell_y[k] - low_y)) * width + (cell_x[k] - low_x)
        buckets[k] = place if cell_x[k] != FAR else np.int32(-1)


@routine
def enter(first, last, count, table):
    """Write each particle's index of its cell in the table, -1 if it has none."""
    cells, low, counts = table.cells, table.low, table.counts
    if table.holds[0] != 0:
        enter_rows(
            last - first, row_at(cells, first), row_at(cells, count + first), row_at(cells, 2 * count + first),
            np.int32(low[0]), np.int32(low[1]), np.int32(low[2]), np.int32(counts[0]), np.int32(counts[1]),
            row_at(table.buckets, first),
        )  # fmt: skip
        return
    for k in range(first, last):
        x = within_table(cells[k], low[0], counts[0])
        y = within_table(cells[count + k], low[1], counts[1])
        z = within_table(cells[2 * count + k], low[2], counts[2])
        table.buckets[k] = np.int32((z * counts[1] + y) * counts[0] + x) if cells[k] != FAR else np.int32(-1)


@routine
def tally(low, high, buckets, starts):
    """Count the particles in each of the cells `low` to before `high`, for a stable counting sort. Returns their sum."""
    inside = 0
    for b in range(low, high):
        starts[b] = 0
    for k in range(buckets.size):
        b = buckets[k]
        if low <= b < high:
            starts[b] += 1
            inside += 1
    return inside


@routine
def put(low, high, end, count, position, arrays):
    """Write particles in the order of cells; `end`: number of particles in the cells before. Afterwards starts[b]
    is the first of cell b."""
    buckets, starts = arrays.table.buckets, arrays.table.starts
    order, places, bodies = arrays.in_order.order, arrays.in_order.places, arrays.in_order.bodies
    body, rest, capacity = arrays.particles.body, arrays.particles.rest, order.size
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
                places[axis * capacity + q] = position[axis * count + k]
                places[(AXES + axis) * capacity + q] = rest[axis * count + k]


@routine
def runs_around(b, table, runs):
    """Write begin and end of the runs of sorted particles in the 27 cells around cell b, without empty runs, and return
    how many numbers."""
    width, height, depth, starts, n = table.counts[0], table.counts[1], table.counts[2], table.starts, 0
    if table.holds[0] != 0:  # every cell with particles has cells around it in the table
        for place in range(9):
            cell = b + (place // 3 - 1) * (width * height) + (place % 3 - 1) * width
            runs[n], runs[n + 1] = starts[cell - 1], starts[cell + 2]
            n += 2 if runs[n + 1] > runs[n] else 0
        return n
    x, y, z = b % width, b // width % height, b // (width * height)
    for place in range(27):
        row = (z + place // 9 - 1 + depth) % depth * height + (y + place // 3 % 3 - 1 + height) % height
        cell = row * width + (x + place % 3 - 1 + width) % width
        runs[n], runs[n + 1] = starts[cell], starts[cell + 1]
        n += 2 if runs[n + 1] > runs[n] else 0
    return n
