"""The phases of a fluid's density constraint on CPU threads, over slices of LANES particles (model/fluid/plan.py, 3 to
5).

Positions are stored as planes, and again as quads behind them (after QUADS planes). Neighbours are read from the quads
(cpu_backend/fluid/quads.py).
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row, instants
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.arrays import Around, Pairs, Sides
from softlab.cpu_backend.fluid.lists import AROUND, RUNS, find_neighbours
from softlab.cpu_backend.fluid.pairs import corrections, densities, gradients
from softlab.cpu_backend.fluid.phases import cells_in, positions
from softlab.cpu_backend.fluid.quads import LANES, QUAD, QUADS
from softlab.cpu_backend.fluid.rows import (
    DOUBLE_BLOCKS,
    SINGLE_BLOCKS,
    factor_rows,
    move_rows,
    numbers_of,
    relax_rows,
    sums_of,
    vector_at,
)
from softlab.cpu_backend.fluid.walls import wall_rows
from softlab.model.base.variant import FEATURE, filled, open_constant, routine

constrains = open_constant("True if `factors` also does the first `constrain`, which sums over the same neighbours")


@routine
def sides_of(p):
    """Return the Sides of arrays.py."""
    if FEATURE.repeats:
        return Sides(p.side_x, p.side_y, p.side_z, p.half_x, p.half_y, p.half_z)
    return Sides(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@routine
def pairs_of(p):
    """Return the Pairs of arrays.py."""
    return Pairs(sides_of(p), p.support, p.inverse_support, p.gradient_scale, p.tensile, p.inverse_tensile)


@routine
def search(part, shared, at, world):
    """Build the neighbour lists of a band's slices."""
    parameters, near, here = world.parameters, world.scratch.near, np.int64(part) * (4 * AROUND)
    slices = (world.sizes.particles + LANES - 1) // LANES
    around = Around(
        row_at(near, here), row_at(near, here + AROUND), row_at(near, here + 2 * AROUND), row_at(near, here + 3 * AROUND),
        row_at(world.scratch.who, np.int64(part) * AROUND), row_at(world.scratch.runs, np.int64(part) * RUNS),
    )  # fmt: skip
    _, _, cells = cells_in(shared, world)
    first, last = slices * part // shared, slices * (part + 1) // shared
    world.lists.counts[part] += find_neighbours(first, last, world, cells, sides_of(parameters), parameters, around)


@routine
def put_changes(quads, delta):
    """Store the changes of a slice's multipliers in the quads of the slice."""
    for lane in range(LANES):
        quads[QUAD * lane + QUAD - 1] = delta[lane]


@routine
def factors(part, shared, at, world):
    """Build the neighbour lists, and evaluate the factors."""
    search(part, shared, at, world)
    parameters, fluids = world.parameters, world.fluids
    count, capacity, in_order = world.sizes.particles, world.sizes.capacity, world.in_order
    longest, entries, work = world.lists.longest, world.lists.entries, world.work
    place, fluid, delta, wall = in_order.position, in_order.fluid, work.delta, work.wall
    slices, (_, end, _) = (count + LANES - 1) // LANES, instants(at.number, parameters)
    gx, gy, gz, squares, total, wall_part = sums_of(part, world.scratch.sums)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            gx[lane], gy[lane], gz[lane], squares[lane], total[lane] = 0.0, 0.0, 0.0, 0.0, 0.0
        gradients(
            longest[s], base, row_at(entries, base * FEATURE.neighbours), row_at(place, QUADS * capacity),
            numbers_of(part, world.scratch.sums), vector_at(place, capacity, base), pairs_of(parameters), fluid, fluids,
            (gx, gy, gz, squares, total),
        )  # fmt: skip
        if FEATURE.walls:
            wall_rows(end, world, vector_at(place, capacity, base), wall_part, vector_at(wall, capacity, base))
        factor_rows(
            parameters.relaxation, parameters.softness, row_at(fluid, base), fluids, (gx, gy, gz, squares),
            vector_at(wall, capacity, base), row_at(work.factor, base), row_at(work.multiplier, base),
        )  # fmt: skip
        if constrains:
            relax_rows(
                parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(work.factor, base),
                row_at(work.multiplier, base), row_at(delta, base), row_at(work.error, base),
            )  # fmt: skip
            put_changes(row_at(place, QUADS * capacity + QUAD * base), row_at(delta, base))


find, prepare = (filled(factors, {"constrains": also}) for also in (False, True))


@routine
def constrain(part, shared, at, world):
    """Evaluate the constraints, and the changes of their multipliers."""
    parameters, (place, _) = world.parameters, positions(at.iteration, world)
    count, capacity, lists, work = world.sizes.particles, world.sizes.capacity, world.lists, world.work
    scratch = world.scratch.sums
    slices, (_, end, _) = (count + LANES - 1) // LANES, instants(at.number, parameters)
    total, _, _, _, _, wall_part = sums_of(part, scratch)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            total[lane] = 0.0
        densities(
            lists.longest[s], row_at(lists.entries, base * FEATURE.neighbours), row_at(place, QUADS * capacity),
            numbers_of(part, scratch), vector_at(place, capacity, base), pairs_of(parameters), total,
        )  # fmt: skip
        if FEATURE.walls:
            wall_rows(end, world, vector_at(place, capacity, base), wall_part, vector_at(work.wall, capacity, base))
        relax_rows(
            parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(work.factor, base),
            row_at(work.multiplier, base), row_at(work.delta, base), row_at(work.error, base),
        )  # fmt: skip
        put_changes(row_at(place, QUADS * capacity + QUAD * base), row_at(work.delta, base))


@routine
def correct(part, shared, at, world):
    """Correct the positions of an iteration."""
    parameters, (place, there) = world.parameters, positions(at.iteration, world)
    capacity, in_order, delta, lists = world.sizes.capacity, world.in_order, world.work.delta, world.lists
    scratch = world.scratch.sums
    longest, entries, before, fluid = lists.longest, lists.entries, in_order.before, in_order.fluid
    slices = (world.sizes.particles + LANES - 1) // LANES
    sums, blocks = sums_of(part, scratch), SINGLE_BLOCKS if FEATURE.single else DOUBLE_BLOCKS
    ax, ay, az = sums[:3]
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            ax[lane], ay[lane], az[lane] = 0.0, 0.0, 0.0
        corrections(
            longest[s], base, row_at(entries, base * FEATURE.neighbours), row_at(place, QUADS * capacity),
            numbers_of(part, scratch), vector_at(place, capacity, base), row_at(delta, base), pairs_of(parameters),
            (ax, ay, az),
        )  # fmt: skip
        move_rows(
            row_at(fluid, base), world.fluids, row_at(delta, base), vector_at(world.work.wall, capacity, base),
            vector_at(place, capacity, base), sums,
        )  # fmt: skip
        if FEATURE.colliders:
            collide_row(
                world.bodies, world.kinds, at.number, parameters, blocks, before, base, capacity, ax, np.int64(0), LANES
            )
        quads = row_at(there, QUADS * capacity + QUAD * base)
        for lane in range(LANES):
            there[base + lane], there[capacity + base + lane] = ax[lane], ay[lane]
            there[2 * capacity + base + lane] = az[lane]
            quads[QUAD * lane], quads[QUAD * lane + 1], quads[QUAD * lane + 2] = ax[lane], ay[lane], az[lane]
