"""The phases of a fluid's substep up to the sort, on CPU threads, one band at a time (model/fluid/plan.py, 1 and 2).

All take the same `world`, a tuple of tuples made by `Fluid` of cpu_backend/fluid/solver.py.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.fluid.cells import make_predict, make_sort, make_table


def make_order(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """Make `predict`, `enter`, `tally`, `put`: the phases up to the sort, (part, parts, step, world, ...)."""
    predict_some, table_made, sort = (
        make_predict(compiler, real, parts),
        make_table(compiler, real),
        make_sort(compiler, parts),
    )
    span, enter_some, tally_some, put_some = table_made.span, table_made.enter, sort.tally, sort.put
    compiled = compiler.compiled

    @compiled
    def predict(part, shared, step, number, world, parameters, fluids, integers, bodies, kinds):
        (count, room, _), state, unsorted, _, _, table, lists, _ = world
        first, last = count * part // shared, count * (part + 1) // shared
        lists.counts[shared + part] += predict_some(
            part, first, last, step, number, room, state, unsorted, table.boxes, parameters, fluids, integers, bodies, kinds
        )  # fmt: skip

    @compiled
    def cells_in(shared, world, parameters):
        """Return (lowest positions, inverse cell edges, counts) of the table."""
        table = world.table
        return span(shared, table.boxes, table.starts.size - 1, parameters)

    @compiled
    def enter(part, shared, world, parameters):
        (count, room, _), _, unsorted, _, _, table, _, _ = world
        low, inverse, counts = cells_in(shared, world, parameters)
        first, last = count * part // shared, count * (part + 1) // shared
        enter_some(first, last, room, unsorted.position, low, inverse, counts, table.cell)

    @compiled
    def tally(part, shared, world, parameters):
        (count, _, _), _, _, _, _, (_, cell, starts, _, totals), _, _ = world
        _, _, (nx, ny, nz) = cells_in(shared, world, parameters)
        cells = nx * ny * nz
        totals[part] = tally_some(cells * part // shared, cells * (part + 1) // shared, count, cell, starts)

    @compiled
    def put(part, shared, world, parameters):
        (count, room, _), state, unsorted, in_order, _, (_, cell, starts, order, totals), _, _ = world
        _, _, (nx, ny, nz) = cells_in(shared, world, parameters)
        cells, first = nx * ny * nz, 0
        for k in range(part):
            first += totals[k]
        low, high = cells * part // shared, cells * (part + 1) // shared
        end = put_some(low, high, first, count, room, state, unsorted, in_order, cell, starts, order)
        if part == shared - 1:
            starts[cells] = np.int32(end)

    return SimpleNamespace(predict=predict, enter=enter, tally=tally, put=put, cells_in=cells_in)
