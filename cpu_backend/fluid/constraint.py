"""The phases of a fluid's density constraint on CPU threads, over slices of LANES particles (model/fluid/plan.py, 3 to
5).

Positions are stored as planes, and again as quads behind them (after QUADS planes). Neighbours are read from the quads
(cpu_backend/fluid/quads.py).
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_row, make_instants
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.fluid.arrays import Around, Sides
from softlab.cpu_backend.fluid.lists import AROUND, RUNS, make_find
from softlab.cpu_backend.fluid.pairs import make_pairs
from softlab.cpu_backend.fluid.quads import LANES, QUAD, QUADS
from softlab.cpu_backend.fluid.rows import make_rows, make_scratch
from softlab.cpu_backend.fluid.walls import make_wall_rows
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import MAX_NEIGHBOURS
from softlab.model.tables.cloth import COLLIDER_KINDS


def make_sides_of(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make sides_of(parameters): Sides of arrays.py."""
    repeats, zero = "repeats" in parts, real(0)

    @compiler.compiled
    def sides_of(p):
        if repeats:
            return Sides(p.side_x, p.side_y, p.side_z, p.half_x, p.half_y, p.half_z)
        return Sides(zero, zero, zero, zero, zero, zero)

    return sides_of


def make_search_phases(compiler: Compiler, real: Real, parts: frozenset[str], cells_in: Callable) -> SimpleNamespace:
    """Make `find` and `prepare`, both (part, parts, number, world, parameters, fluids, bodies, kinds).

    `find` builds the neighbour lists and the factors. `prepare` also does the first `constrain`, which sums over the
    same neighbours.
    """
    search = _make_search(compiler, real, parts, cells_in)
    return SimpleNamespace(
        find=_make_factors(compiler, real, parts, search, False),
        prepare=_make_factors(compiler, real, parts, search, True),
    )


def _make_search(compiler: Compiler, real: Real, parts: frozenset[str], cells_in: Callable) -> Callable:
    """Make search(part, parts, world, parameters): it builds the neighbour lists of a band's slices."""
    find_some = make_find(compiler, real, parts, MAX_NEIGHBOURS[2 if "flat" in parts else 3])
    sides_of = make_sides_of(compiler, real, parts)

    @compiler.compiled
    def search(part, shared, world, parameters):
        near, here = world.scratch.near, np.int64(part) * (4 * AROUND)
        slices = (world.sizes.particles + LANES - 1) // LANES
        around = Around(
            row_at(near, here), row_at(near, here + AROUND), row_at(near, here + 2 * AROUND), row_at(near, here + 3 * AROUND),
            row_at(world.scratch.who, np.int64(part) * AROUND), row_at(world.scratch.runs, np.int64(part) * RUNS),
        )  # fmt: skip
        _, _, cells = cells_in(shared, world, parameters)
        first, last = slices * part // shared, slices * (part + 1) // shared
        world.lists.counts[part] += find_some(first, last, world, cells, sides_of(parameters), parameters, around)

    return search


def _make_factors(
    compiler: Compiler, real: Real, parts: frozenset[str], search: Callable, constrains: bool
) -> Callable:
    gradients, wall_rows = make_pairs(compiler, real, parts).gradients, make_wall_rows(compiler, real, parts)
    sides_of, instants = make_sides_of(compiler, real, parts), make_instants(compiler, real, parts)
    scratch_of, rows = make_scratch(compiler), make_rows(compiler, real, parts)
    sums_of, numbers_of, vector_at = scratch_of.sums_of, scratch_of.numbers_of, scratch_of.vector_at
    factor_rows, relax, put = rows.factors, rows.relax, make_put(compiler)
    most, has_walls, zero = MAX_NEIGHBOURS[2 if "flat" in parts else 3], "walls" in parts, real(0)

    @compiler.compiled
    def factors(part, shared, number, world, parameters, fluids, bodies, kinds):
        search(part, shared, world, parameters)
        count, capacity, in_order = world.sizes.particles, world.sizes.room, world.in_order
        longest, entries, work = world.lists.longest, world.lists.entries, world.work
        place, fluid, delta, wall = in_order.position, in_order.fluid, work.delta, work.wall
        slices, sides, (_, end, _) = (count + LANES - 1) // LANES, sides_of(parameters), instants(number, parameters)
        gx, gy, gz, squares, total, wall_part = sums_of(part, world.scratch.sums)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                gx[lane], gy[lane], gz[lane], squares[lane], total[lane] = zero, zero, zero, zero, zero
            gradients(
                longest[s], base, row_at(entries, base * most), row_at(place, QUADS * capacity),
                *numbers_of(part, world.scratch.sums), *vector_at(place, capacity, base), sides, parameters.support,
                parameters.inverse_support, parameters.gradient_scale, fluid, fluids, gx, gy, gz, squares, total,
            )  # fmt: skip
            if has_walls:
                wall_rows(
                    bodies, kinds, end, parameters, *vector_at(place, capacity, base), wall_part,
                    *vector_at(wall, capacity, base)
                )  # fmt: skip
            factor_rows(
                parameters.relaxation, parameters.softness, row_at(fluid, base), fluids, gx, gy, gz, squares,
                *vector_at(wall, capacity, base), row_at(work.factor, base), row_at(work.multiplier, base),
            )  # fmt: skip
            if constrains:
                relax(
                    parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(work.factor, base),
                    row_at(work.multiplier, base), row_at(delta, base), row_at(work.error, base),
                )  # fmt: skip
                put(row_at(place, QUADS * capacity + QUAD * base), row_at(delta, base))

    return factors


def make_put(compiler: Compiler) -> Callable:
    """Make put(quads, delta): it stores the changes of a slice's multipliers in the quads of the slice."""

    @compiler.compiled
    def put(quads, delta):
        for lane in range(LANES):
            quads[QUAD * lane + QUAD - 1] = delta[lane]

    return put


def make_iteration(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make the phases of an iteration.

    `constrain(part, parts, number, place, world, parameters, bodies, kinds)` and `correct(part, parts, number, place,
    there, world, parameters, fluids, bodies, kinds)`.
    """
    return SimpleNamespace(
        constrain=_make_constrain(compiler, real, parts), correct=_make_correct(compiler, real, parts)
    )


def _make_constrain(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    densities, wall_rows = make_pairs(compiler, real, parts).densities, make_wall_rows(compiler, real, parts)
    sides_of, instants = make_sides_of(compiler, real, parts), make_instants(compiler, real, parts)
    scratch_of, relax = make_scratch(compiler), make_rows(compiler, real, parts).relax
    sums_of, numbers_of, vector_at = scratch_of.sums_of, scratch_of.numbers_of, scratch_of.vector_at
    most, has_walls, zero = MAX_NEIGHBOURS[2 if "flat" in parts else 3], "walls" in parts, real(0)
    put = make_put(compiler)

    @compiler.compiled
    def constrain(part, shared, number, place, world, parameters, bodies, kinds):
        """Evaluate the constraints at the positions `place`, and the changes of their multipliers."""
        count, capacity, lists, work = world.sizes.particles, world.sizes.room, world.lists, world.work
        scratch = world.scratch.sums
        slices, sides, (_, end, _) = (count + LANES - 1) // LANES, sides_of(parameters), instants(number, parameters)
        total, _, _, _, _, wall_part = sums_of(part, scratch)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                total[lane] = zero
            densities(
                lists.longest[s], row_at(lists.entries, base * most), row_at(place, QUADS * capacity),
                *numbers_of(part, scratch), *vector_at(place, capacity, base), sides, parameters.inverse_support, total,
            )  # fmt: skip
            if has_walls:
                wall_rows(
                    bodies, kinds, end, parameters, *vector_at(place, capacity, base), wall_part,
                    *vector_at(work.wall, capacity, base)
                )  # fmt: skip
            relax(
                parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(work.factor, base),
                row_at(work.multiplier, base), row_at(work.delta, base), row_at(work.error, base),
            )  # fmt: skip
            put(row_at(place, QUADS * capacity + QUAD * base), row_at(work.delta, base))

    return constrain


def _make_correct(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    corrections, sides_of = make_pairs(compiler, real, parts).corrections, make_sides_of(compiler, real, parts)
    collide, scratch_of = make_collide_row(compiler, real, parts), make_scratch(compiler)
    sums_of, numbers_of, vector_at = scratch_of.sums_of, scratch_of.numbers_of, scratch_of.vector_at
    move, most = make_rows(compiler, real, parts).move, MAX_NEIGHBOURS[2 if "flat" in parts else 3]
    has_bodies, zero, blocks = bool(parts & set(COLLIDER_KINDS)), real(0), LANES // block_of(real)

    @compiler.compiled
    def correct(part, shared, number, place, there, world, parameters, fluids, bodies, kinds):
        """Correct the positions `place` and store them in `there`."""
        capacity, in_order, delta, lists = world.sizes.room, world.in_order, world.work.delta, world.lists
        scratch = world.scratch.sums
        longest, entries, before, fluid = lists.longest, lists.entries, in_order.before, in_order.fluid
        slices, sides = (world.sizes.particles + LANES - 1) // LANES, sides_of(parameters)
        sums = sums_of(part, scratch)
        ax, ay, az = sums[:3]
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                ax[lane], ay[lane], az[lane] = zero, zero, zero
            corrections(
                longest[s], base, row_at(entries, base * most), row_at(place, QUADS * capacity), *numbers_of(part, scratch),
                *vector_at(place, capacity, base), row_at(delta, base), sides, parameters.support, parameters.inverse_support,
                parameters.gradient_scale, parameters.tensile, parameters.inverse_tensile, ax, ay, az,
            )  # fmt: skip
            move(
                row_at(fluid, base), fluids, row_at(delta, base), *vector_at(world.work.wall, capacity, base),
                *vector_at(place, capacity, base), *sums,
            )  # fmt: skip
            if has_bodies:
                collide(bodies, kinds, number, parameters, blocks, before, base, capacity, ax, np.int64(0), LANES)
            quads = row_at(there, QUADS * capacity + QUAD * base)
            for lane in range(LANES):
                there[base + lane], there[capacity + base + lane] = ax[lane], ay[lane]
                there[2 * capacity + base + lane] = az[lane]
                quads[QUAD * lane], quads[QUAD * lane + 1], quads[QUAD * lane + 2] = ax[lane], ay[lane], az[lane]

    return correct
