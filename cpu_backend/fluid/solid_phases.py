"""The phases of a fluid's substep that involve solids, on CPU threads (model/fluid/plan.py, Solids).

`coupling`: Solids of fluid/arrays.py.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.contact.colliders import make_collide_mass, make_instants
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import AXES, BOX, LARGEST, make_row_of
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.rows import make_rows, make_scratch
from softlab.cpu_backend.fluid.solid_pairs import make_solid_pairs
from softlab.cpu_backend.fluid.walls import make_wall_rows
from softlab.model.base.types import Real
from softlab.model.fluid.among_solids import K_GRIP, K_LIGHTNESS, KINDS
from softlab.model.fluid.parameters import F_WEIGHT, MAX_NEIGHBOURS
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid import density, solids
from softlab.model.tables.cloth import COLLIDER_KINDS

SUMS = 5  # rows of LANES for each band


def make_sampling(compiler: Compiler, real: Real) -> SimpleNamespace:
    """Make `sample`, `gather`, `follow`, `push`: phases that couple samples to solids, (part, parts, ...)."""
    compiled, formulas = compiler.compiled, compiler.formulas(solids, real)
    middle, carried_on = formulas.middle, formulas.carried_on
    moved = compiler.formulas(density, real).moved
    zero, largest = real(0), real(LARGEST)

    @compiled
    def point(s, corners, weights, rows):
        """Return the position of sample s between its corners, of particles in rows of three."""
        at = CORNERS * s
        i, j, k = AXES * np.int64(corners[at]), AXES * np.int64(corners[at + 1]), AXES * np.int64(corners[at + 2])
        a, b, c = weights[at], weights[at + 1], weights[at + 2]
        return (
            middle(rows[i], rows[j], rows[k], a, b, c), middle(rows[i + 1], rows[j + 1], rows[k + 1], a, b, c),
            middle(rows[i + 2], rows[j + 2], rows[k + 2], a, b, c),
        )  # fmt: skip

    @compiled
    def sample(part, shared, world, coupling):
        """Write the predicted positions of samples among the unsorted particles, and the bounding box of the band."""
        count, capacity, before = world.sizes.particles, world.sizes.room, world.unsorted.before
        place, predicted_velocity, table = world.unsorted.position, world.unsorted.velocity, world.table
        corners, weights = coupling.points.corners, coupling.points.weights
        number, boxes = world.state.number, table.boxes
        lx, ly, lz, hx, hy, hz = largest, largest, largest, -largest, -largest, -largest
        for k in range(count * part // shared, count * (part + 1) // shared):
            s = np.int64(number[k]) - coupling.fluids
            if s >= 0:
                before[k], before[capacity + k], before[2 * capacity + k] = point(
                    s, corners, weights, coupling.places.before
                )
                place[k], place[capacity + k], place[2 * capacity + k] = point(
                    s, corners, weights, coupling.places.position
                )
                predicted_velocity[k], predicted_velocity[capacity + k], predicted_velocity[2 * capacity + k] = (
                    zero,
                    zero,
                    zero,
                )
            x, y, z = place[k], place[capacity + k], place[2 * capacity + k]
            if abs(x) < largest and abs(y) < largest and abs(z) < largest:
                lx, ly, lz, hx, hy, hz = min(lx, x), min(ly, y), min(lz, z), max(hx, x), max(hy, y), max(hz, z)
        box = BOX * np.int64(part)
        boxes[box], boxes[box + 1], boxes[box + 2] = lx, ly, lz
        boxes[box + 3], boxes[box + 4], boxes[box + 5] = hx, hy, hz

    @compiled
    def gather(part, shared, world, coupling):
        """Copy `kinds` into the order of cells, and store the slots of samples."""
        count, capacity = world.sizes.particles, world.sizes.room
        fluids, kinds = coupling.fluids, coupling.kinds
        number = world.in_order.number
        for i in range(count * part // shared, count * (part + 1) // shared):
            n = np.int64(number[i])
            for kind in range(KINDS):
                kinds[kind * capacity + i] = coupling.kinds_by_number[kind * count + n]
            if n >= fluids:
                coupling.slots[n - fluids] = np.int32(i)

    @compiled
    def follow(part, shared, place, world, coupling):
        """Write the current positions of samples."""
        capacity = world.sizes.room
        slots, weights, position = coupling.slots, coupling.points.weights, coupling.places.position
        many = slots.size
        for s in range(many * part // shared, many * (part + 1) // shared):
            i = np.int64(slots[s])
            place[i], place[capacity + i], place[2 * capacity + i] = point(
                s, coupling.points.corners, weights, position
            )

    @compiled
    def push(part, shared, coupling):
        """Move the solids' particles by the shifts of their samples, summed in the order of the samples."""
        position, lightness, offsets = coupling.places.position, coupling.carriers.lightness, coupling.carriers.offsets
        weights, shift = coupling.carriers.weights, coupling.shift
        many, capacity = lightness.size, coupling.slots.size
        for k in range(many * part // shared, many * (part + 1) // shared):
            x, y, z = zero, zero, zero
            for e in range(offsets[k], offsets[k + 1]):
                s = np.int64(coupling.carriers.samples[e])
                x, y = carried_on(x, weights[e], shift[s]), carried_on(y, weights[e], shift[capacity + s])
                z = carried_on(z, weights[e], shift[2 * capacity + s])
            at = AXES * np.int64(k)
            position[at], position[at + 1] = (
                moved(position[at], lightness[k], x),
                moved(position[at + 1], lightness[k], y),
            )
            position[at + 2] = moved(position[at + 2], lightness[k], z)

    return SimpleNamespace(sample=sample, gather=gather, follow=follow, push=push)


def make_solid_constraint(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `factors`, `constrain`, `correct`: phases of the density constraint among solids, over slices of LANES."""
    return SimpleNamespace(
        factors=_make_factors(compiler, real, parts), constrain=_make_constrain(compiler, real, parts),
        correct=_make_correct(compiler, real, parts),
    )  # fmt: skip


def _make_factors(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    gradients, vector_at = make_solid_pairs(compiler, real, parts).gradients, make_scratch(compiler).vector_at
    wall_rows, instants = make_wall_rows(compiler, real, parts), make_instants(compiler, real, parts)
    factor_rows, most = make_rows(compiler, real, parts).factors, MAX_NEIGHBOURS[AXES]
    has_walls, zero = "walls" in parts, real(0)

    @compiler.compiled
    def factors(part, shared, number, world, coupling, scratch, parameters, fluids, bodies, kinds_of):
        """Evaluate the neighbour factors of the constraint; 0 for samples."""
        count, capacity, in_order = world.sizes.particles, world.sizes.room, world.in_order
        factor, wall, longest = world.work.factor, world.work.wall, world.lists.longest
        entries = world.lists.entries
        first, kinds, place, numbers, fluid = (
            coupling.fluids,
            coupling.kinds,
            in_order.position,
            in_order.number,
            in_order.fluid,
        )
        _, end, _ = instants(number, parameters)
        at, slices = np.int64(part) * (SUMS * LANES), (count + LANES - 1) // LANES
        gx, gy, gz = row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES)
        squares, wall_part = row_at(scratch, at + 3 * LANES), row_at(scratch, at + 4 * LANES)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                gx[lane], gy[lane], gz[lane], squares[lane] = zero, zero, zero, zero
            gradients(
                longest[s], base, row_at(entries, base * most), place, row_at(place, capacity),
                row_at(place, 2 * capacity), *vector_at(place, capacity, base), parameters.support,
                parameters.inverse_support, parameters.gradient_scale, kinds, row_at(kinds, K_LIGHTNESS * capacity), gx,
                gy, gz, squares,
            )  # fmt: skip
            if has_walls:
                wall_rows(
                    bodies, kinds_of, end, parameters, *vector_at(place, capacity, base), wall_part,
                    *vector_at(wall, capacity, base)
                )  # fmt: skip
            factor_rows(
                parameters.relaxation, parameters.softness, row_at(fluid, base), fluids, gx, gy, gz, squares,
                *vector_at(wall, capacity, base), row_at(factor, base), row_at(world.work.multiplier, base),
            )  # fmt: skip
            for i in range(base, min(base + LANES, count)):
                if numbers[i] >= first:
                    factor[i] = zero

    return factors


def _make_constrain(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    densities, vector_at = make_solid_pairs(compiler, real, parts).densities, make_scratch(compiler).vector_at
    wall_rows, instants = make_wall_rows(compiler, real, parts), make_instants(compiler, real, parts)
    relax, most, has_walls, zero = (
        make_rows(compiler, real, parts - {"averaged"}).relax, MAX_NEIGHBOURS[AXES], "walls" in parts, real(0)
    )  # fmt: skip

    @compiler.compiled
    def constrain(part, shared, number, place, world, coupling, scratch, parameters, bodies, kinds_of):
        """Evaluate the constraints at the positions `place`, and the changes of their multipliers; 0 for samples."""
        count, capacity, multiplier = world.sizes.particles, world.sizes.room, world.work.multiplier
        delta, error, wall, lists = world.work.delta, world.work.error, world.work.wall, world.lists
        first, kinds, numbers = coupling.fluids, coupling.kinds, world.in_order.number
        longest, entries, slices = lists.longest, lists.entries, (count + LANES - 1) // LANES
        _, end, _ = instants(number, parameters)
        at = np.int64(part) * (SUMS * LANES)
        total, wall_part = row_at(scratch, at), row_at(scratch, at + 4 * LANES)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                total[lane] = zero
            densities(
                longest[s], row_at(entries, base * most), place, row_at(place, capacity), row_at(place, 2 * capacity),
                *vector_at(place, capacity, base), parameters.inverse_support, kinds, total,
            )  # fmt: skip
            if has_walls:
                wall_rows(
                    bodies, kinds_of, end, parameters, *vector_at(place, capacity, base), wall_part,
                    *vector_at(wall, capacity, base)
                )  # fmt: skip
            relax(
                parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(world.work.factor, base),
                row_at(multiplier, base), row_at(delta, base), row_at(error, base),
            )  # fmt: skip
            for i in range(base, min(base + LANES, count)):
                if numbers[i] >= first:
                    error[i], delta[i], multiplier[i] = zero, zero, zero

    return constrain


def _make_correct(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    compiled, f, vector_at = compiler.compiled, compiler.formulas(density, real), make_scratch(compiler).vector_at
    wall_added, moved, most = f.wall_added, f.moved, MAX_NEIGHBOURS[AXES]
    pairs, touch = make_solid_pairs(compiler, real, parts), make_collide_mass(compiler, real, parts)
    corrections, frictions = pairs.corrections, pairs.frictions
    has_walls, has_bodies = "walls" in parts, bool(parts & set(COLLIDER_KINDS))
    row_of, zero = compiled(make_row_of(parts)), real(0)

    @compiled
    def correct(part, shared, number, place, there, world, coupling, scratch, parameters, fluids, bodies, kinds_of):
        """Correct the positions `place` and store them in `there`; store the shifts of samples."""
        count, capacity, in_order, delta = world.sizes.particles, world.sizes.room, world.in_order, world.work.delta
        wall, lists = world.work.wall, world.lists
        first, kinds, slots, shift = coupling.fluids, coupling.kinds, coupling.slots, coupling.shift
        before, numbers, fluid = in_order.before, in_order.number, in_order.fluid
        neighbours, longest, entries, slices = (
            lists.neighbours,
            lists.longest,
            lists.entries,
            (count + LANES - 1) // LANES,
        )
        at, many = np.int64(part) * (SUMS * LANES), slots.size
        ax, ay, az = row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES)
        grip, lightness = row_at(kinds, K_GRIP * capacity), row_at(kinds, K_LIGHTNESS * capacity)
        for s in range(slices * part // shared, slices * (part + 1) // shared):
            base = np.int64(s) * LANES
            for lane in range(LANES):
                ax[lane], ay[lane], az[lane] = zero, zero, zero
            corrections(
                longest[s], base, row_at(entries, base * most), place, row_at(place, capacity),
                row_at(place, 2 * capacity), delta, kinds, grip, *vector_at(place, capacity, base), row_at(delta, base),
                row_at(kinds, base), row_at(grip, base), parameters.support, parameters.inverse_support,
                parameters.gradient_scale, parameters.tensile, parameters.inverse_tensile, ax, ay, az,
            )  # fmt: skip
            for lane in range(min(LANES, count - base)):
                i = base + lane
                cx, cy, cz = frictions(
                    i, neighbours[i], row_at(entries, base * most + lane), capacity, place, before,
                    parameters.inverse_support, grip, lightness, fluid, fluids, ax[lane], ay[lane], az[lane],
                )  # fmt: skip
                px, py, pz = place[i], place[capacity + i], place[2 * capacity + i]
                sample = np.int64(numbers[i]) - first
                if sample >= 0:
                    shift[sample], shift[many + sample], shift[2 * many + sample] = cx, cy, cz
                else:
                    weight = fluids[row_of(fluid, i) + F_WEIGHT]
                    if has_walls:
                        cx, cy = wall_added(cx, delta[i], wall[i]), wall_added(cy, delta[i], wall[capacity + i])
                        cz = wall_added(cz, delta[i], wall[2 * capacity + i])
                    px, py, pz = moved(px, weight, cx), moved(py, weight, cy), moved(pz, weight, cz)
                    if has_bodies:
                        a = before[i], before[capacity + i], before[2 * capacity + i]
                        (px, py, pz), _ = touch(
                            bodies, kinds_of, number, parameters, a, (px, py, pz), (zero, zero, zero)
                        )  # fmt: skip
                there[i], there[capacity + i], there[2 * capacity + i] = px, py, pz

    return correct
