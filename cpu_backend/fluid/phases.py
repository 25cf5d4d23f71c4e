"""The phases of a fluid's substep on CPU threads, one part of each at a time: model/fluid/plan.py says what they do.

All are given the same `world`, a tuple of tuples: see `Fluid` of cpu_backend/fluid/solver.py, which makes it.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from cpu_backend.contact.colliders import make_collide_mass, make_instants
from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from cpu_backend.fluid.cells import make_predict, make_row_of, make_sort, make_table
from cpu_backend.fluid.lists import AROUND, LANES, RUNS, make_find
from cpu_backend.fluid.pairs import make_pairs
from cpu_backend.fluid.walls import make_walls
from model.fluid.parameters import F_WEIGHT, MAX_NEIGHBOURS
from model.formulas.fluid import density
from model.scene.cloth import COLLIDER_KINDS

SCRATCH = 4  # rows of LANES for each part: sums


def make_order(compiler: Compiler, real: Any, parts: frozenset[str]) -> SimpleNamespace:
    """`predict`, `enter`, `tally`, `put`: phases until particles lie in order. All take (part, parts, step, world, ...)."""
    predict_some, table_made, sort = (
        make_predict(compiler, real, parts),
        make_table(compiler, real),
        make_sort(compiler, parts),
    )
    span, enter_some, tally_some, put_some = table_made.span, table_made.enter, sort.tally, sort.put
    compiled = compiler.compiled

    @compiled
    def predict(part, shared, step, world, parameters, fluids, integers):
        (count, room, _), state, unsorted, _, _, table, _, _ = world
        first, last = count * part // shared, count * (part + 1) // shared
        predict_some(part, first, last, step, room, state, unsorted, table[0], parameters, fluids, integers)

    @compiled
    def cells_in(shared, world, parameters):
        """(lowest places, inverse edges, counts) of the table."""
        table = world[5]
        return span(shared, table[0], table[2].size - 1, parameters)

    @compiled
    def enter(part, shared, world, parameters):
        (count, room, _), _, unsorted, _, _, table, _, _ = world
        low, inverse, counts = cells_in(shared, world, parameters)
        first, last = count * part // shared, count * (part + 1) // shared
        enter_some(first, last, room, unsorted[1], low, inverse, counts, table[1])

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


def make_constraint(compiler: Compiler, real: Any, parts: frozenset[str], cells_in: Any) -> SimpleNamespace:
    """`find`, `constrain`, `correct`: phases of the density constraint, over slices of LANES particles."""
    compiled, f = compiler.compiled, density.make(real, compiler.compiled)
    constraint, factor_of, change, change_alone = f.constraint, f.factor, f.change, f.change_alone
    wall_added, moved, moved_mean = f.wall_added, f.moved, f.moved_mean
    most = MAX_NEIGHBOURS[2 if "flat" in parts else 3]
    find_some, pairs = make_find(compiler, real, parts, most), make_pairs(compiler, real, parts)
    walls = make_walls(compiler, real, parts)
    densities, gradients, corrections = pairs.densities, pairs.gradients, pairs.corrections
    touch, instants = make_collide_mass(compiler, real, parts), make_instants(compiler, real, parts)
    has_walls, averaged = "walls" in parts, "averaged" in parts
    has_bodies, repeats = bool(parts & set(COLLIDER_KINDS)), "repeats" in parts
    row_of = compiled(make_row_of(parts))
    zero = real(0)

    @compiled
    def sides_of(p):
        """The lengths along which the box repeats, and their halves."""
        if repeats:
            return p.side_x, p.side_y, p.side_z, p.half_x, p.half_y, p.half_z
        return zero, zero, zero, zero, zero, zero

    @compiled
    def find(part, shared, number, world, parameters, fluids, bodies, kinds):
        """Lists of neighbours, and the factors that an iteration multiplies by; multipliers are 0."""
        (count, room, nobody), _, _, in_order, work, (_, cell, starts, order, _), lists, (scratch, near, who, runs) = (
            world
        )
        here = np.int64(part) * (4 * AROUND)
        place, fluid, (_, factor, multiplier, _, _, _) = in_order[1], in_order[4], work
        neighbours, longest, entries, missed = lists
        _, _, counts = cells_in(shared, world, parameters)
        slices, sides = (count + LANES - 1) // LANES, sides_of(parameters)
        first, last = slices * part // shared, slices * (part + 1) // shared
        missed[part] += find_some(
            first, last, count, room, nobody, place, cell, order, starts, counts, sides, parameters,
            (neighbours, longest, entries), (
                row_at(near, here), row_at(near, here + AROUND), row_at(near, here + 2 * AROUND),
                row_at(near, here + 3 * AROUND), row_at(who, np.int64(part) * AROUND), row_at(runs, np.int64(part) * RUNS),
            ), fluid,
        )  # fmt: skip
        _, end, _ = instants(number, parameters)
        at = np.int64(part) * (SCRATCH * LANES)
        gx, gy, gz = row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES)
        own = row_at(scratch, at + 3 * LANES)
        for s in range(first, last):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                gx[lane], gy[lane], gz[lane], own[lane] = zero, zero, zero, zero
            gradients(
                longest[s], base, row_at(entries, base * most), place, row_at(place, room), row_at(place, 2 * room),
                row_at(place, base), row_at(place, room + base), row_at(place, 2 * room + base), sides, parameters.support,
                parameters.inverse_support, parameters.gradient_scale, fluid, fluids, gx, gy, gz, own,
            )  # fmt: skip
            for lane in range(min(LANES, count - base)):
                i = base + lane
                wx, wy, wz = zero, zero, zero
                if has_walls:
                    _, wx, wy, wz = walls(
                        bodies, kinds, end, parameters, place[i], place[room + i], place[2 * room + i]
                    )  # fmt: skip
                factor[i] = factor_of(
                    parameters.relaxation, fluids[row_of(fluid, i) + F_WEIGHT], gx[lane], gy[lane], gz[lane], own[lane], wx,
                    wy, wz, parameters.softness,
                )  # fmt: skip
                multiplier[i] = zero

    @compiled
    def constrain(part, shared, number, place, world, parameters, bodies, kinds):
        """The constraints where particles are at `place`, and the changes of their multipliers."""
        (count, room, _), _, _, _, (_, factor, multiplier, delta, error, wall), _, lists, (scratch, _, _, _) = world
        longest, entries = lists[1], lists[2]
        slices, sides = (count + LANES - 1) // LANES, sides_of(parameters)
        _, end, _ = instants(number, parameters)
        total = row_at(scratch, np.int64(part) * (SCRATCH * LANES))
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                total[lane] = zero
            densities(
                longest[s], row_at(entries, base * most), place, row_at(place, room), row_at(place, 2 * room),
                row_at(place, base), row_at(place, room + base), row_at(place, 2 * room + base), sides,
                parameters.inverse_support, total,
            )  # fmt: skip
            for lane in range(min(LANES, count - base)):
                i = base + lane
                share, wx, wy, wz = zero, zero, zero, zero
                if has_walls:
                    share, wx, wy, wz = walls(
                        bodies, kinds, end, parameters, place[i], place[room + i], place[2 * room + i]
                    )  # fmt: skip
                    wall[i], wall[room + i], wall[2 * room + i] = wx, wy, wz
                c = constraint(total[lane], parameters.density_scale, share)
                error[i] = c
                if averaged:
                    delta[i] = change_alone(factor[i], c)
                else:
                    delta[i] = change(multiplier[i], factor[i], c)
                multiplier[i] = multiplier[i] + delta[i]

    @compiled
    def correct(part, shared, number, place, there, world, parameters, fluids, bodies, kinds):
        """Particles at `place` moved, into `there`."""
        (count, room, _), _, _, in_order, (_, _, _, delta, _, wall), _, lists, (scratch, _, _, _) = world
        neighbours, longest, entries = lists[0], lists[1], lists[2]
        before, fluid = in_order[0], in_order[4]
        slices, sides = (count + LANES - 1) // LANES, sides_of(parameters)
        at = np.int64(part) * (SCRATCH * LANES)
        ax, ay, az = row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                ax[lane], ay[lane], az[lane] = zero, zero, zero
            corrections(
                longest[s], base, row_at(entries, base * most), place, row_at(place, room), row_at(place, 2 * room), delta,
                row_at(place, base), row_at(place, room + base), row_at(place, 2 * room + base), row_at(delta, base), sides,
                parameters.support, parameters.inverse_support, parameters.gradient_scale, parameters.tensile,
                parameters.inverse_tensile, ax, ay, az,
            )  # fmt: skip
            for lane in range(min(LANES, count - base)):
                i = base + lane
                cx, cy, cz, weight = ax[lane], ay[lane], az[lane], fluids[row_of(fluid, i) + F_WEIGHT]
                if has_walls:
                    cx, cy = wall_added(cx, delta[i], wall[i]), wall_added(cy, delta[i], wall[room + i])
                    cz = wall_added(cz, delta[i], wall[2 * room + i])
                px, py, pz = place[i], place[room + i], place[2 * room + i]
                if averaged:
                    met = real(max(neighbours[i], 1))
                    px, py = moved_mean(px, weight, cx, met), moved_mean(py, weight, cy, met)
                    pz = moved_mean(pz, weight, cz, met)
                else:
                    px, py, pz = moved(px, weight, cx), moved(py, weight, cy), moved(pz, weight, cz)
                if has_bodies:
                    px, py, pz, _, _, _ = touch(
                        bodies, kinds, number, parameters, before[i], before[room + i], before[2 * room + i], px, py, pz,
                        zero, zero, zero,
                    )  # fmt: skip
                there[i], there[room + i], there[2 * room + i] = px, py, pz

    return SimpleNamespace(find=find, constrain=constrain, correct=correct, sides_of=sides_of)
