"""The phases of a fluid's substep up to the sort, on CPU threads, one band at a time (model/fluid/plan.py, 1 and 2).

All take the same `world`, Fluid of arrays.py.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.fluid.cells import enter_particles, predict_particles, put_in_order, span, tally_cells
from softlab.model.base.variant import routine


@routine
def predict(part, shared, step, number, world, parameters, fluids, integers, bodies, kinds):
    count, capacity, state, unsorted = world.sizes.particles, world.sizes.room, world.state, world.unsorted
    table = world.table
    first, last = count * part // shared, count * (part + 1) // shared
    world.lists.counts[shared + part] += predict_particles(
        part, first, last, step, number, capacity, state, unsorted, table.boxes, parameters, fluids, integers,
        bodies, kinds
    )  # fmt: skip


@routine
def cells_in(shared, world, parameters):
    """Return (lowest positions, inverse cell edges, counts) of the table."""
    table = world.table
    return span(shared, table.boxes, table.starts.size - 1, parameters)


@routine
def enter(part, shared, world, parameters):
    count, unsorted, table = world.sizes.particles, world.unsorted, world.table
    low, inverse, counts = cells_in(shared, world, parameters)
    first, last = count * part // shared, count * (part + 1) // shared
    enter_particles(first, last, world.sizes.room, unsorted.position, low, inverse, counts, table.cell)


@routine
def tally(part, shared, world, parameters):
    count, starts, totals = world.sizes.particles, world.table.starts, world.table.totals
    _, _, (nx, ny, nz) = cells_in(shared, world, parameters)
    cells = nx * ny * nz
    totals[part] = tally_cells(cells * part // shared, cells * (part + 1) // shared, count, world.table.cell, starts)


@routine
def put(part, shared, world, parameters):
    capacity, state, unsorted, in_order = world.sizes.room, world.state, world.unsorted, world.in_order
    cell, starts, order = world.table.cell, world.table.starts, world.table.order
    _, _, (nx, ny, nz) = cells_in(shared, world, parameters)
    cells, first = nx * ny * nz, 0
    for k in range(part):
        first += world.table.totals[k]
    low, high = cells * part // shared, cells * (part + 1) // shared
    end = put_in_order(
        low, high, first, world.sizes.particles, capacity, state, unsorted, in_order, cell, starts, order
    )
    if part == shared - 1:
        starts[cells] = np.int32(end)
