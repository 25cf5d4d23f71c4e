"""The phases of a fluid's substep up to the sort, on CPU threads, one band at a time (model/fluid/plan.py, 1 and 2).

All take `at` and `world`, At and Fluid of arrays.py.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.fluid.cells import enter_particles, predict_particles, put_in_order, span, tally_cells
from softlab.model.base.variant import routine


@routine
def positions(iteration, world):
    """Return the positions that an iteration starts from, and those that it leads to."""
    if iteration % 2 == 0:
        return world.in_order.position, world.work.next
    return world.work.next, world.in_order.position


@routine
def predict(part, shared, at, world):
    count = world.sizes.particles
    first, last = count * part // shared, count * (part + 1) // shared
    world.lists.counts[shared + part] += predict_particles(part, first, last, at, world)


@routine
def cells_in(shared, world):
    """Return (lowest positions, inverse cell edges, counts) of the table."""
    table = world.table
    return span(shared, table.boxes, table.starts.size - 1, world.parameters)


@routine
def enter(part, shared, at, world):
    count, unsorted, table = world.sizes.particles, world.unsorted, world.table
    low, inverse, counts = cells_in(shared, world)
    first, last = count * part // shared, count * (part + 1) // shared
    enter_particles(first, last, world.sizes.capacity, unsorted.position, low, inverse, counts, table.cell)


@routine
def tally(part, shared, at, world):
    count, starts, totals = world.sizes.particles, world.table.starts, world.table.totals
    _, _, (nx, ny, nz) = cells_in(shared, world)
    cells = nx * ny * nz
    totals[part] = tally_cells(cells * part // shared, cells * (part + 1) // shared, count, world.table.cell, starts)


@routine
def put(part, shared, at, world):
    starts = world.table.starts
    _, _, (nx, ny, nz) = cells_in(shared, world)
    cells, first = nx * ny * nz, 0
    for k in range(part):
        first += world.table.totals[k]
    low, high = cells * part // shared, cells * (part + 1) // shared
    end = put_in_order(low, high, first, world)
    if part == shared - 1:
        starts[cells] = np.int32(end)
