"""The phases of a fluid's substep that involve solids, on CPU threads (model/fluid/plan.py, Solids).

`at`, `world`: At and Fluid of fluid/arrays.py, with `world.solids`.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass, instants
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import AXES, BOX, LARGEST, row_of
from softlab.cpu_backend.fluid.constraint import pairs_of
from softlab.cpu_backend.fluid.phases import positions
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.rows import factor_rows, relax_rows, vector_at
from softlab.cpu_backend.fluid.solid_pairs import corrections, densities, frictions, gradients
from softlab.cpu_backend.fluid.walls import wall_rows
from softlab.model.base.variant import FEATURE, routine
from softlab.model.fluid.among_solids import K_GRIP, K_LIGHTNESS, KINDS
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid.density import moved, wall_added
from softlab.model.formulas.fluid.solids import carried_on, middle

SUMS = 5  # rows of LANES for each band


@routine
def sample_position(s, corners, weights, rows):
    """Return the position of sample s between its corners, of particles in rows of three."""
    at = CORNERS * s
    i, j, k = AXES * np.int64(corners[at]), AXES * np.int64(corners[at + 1]), AXES * np.int64(corners[at + 2])
    a, b, c = weights[at], weights[at + 1], weights[at + 2]
    return (
        middle(rows[i], rows[j], rows[k], a, b, c), middle(rows[i + 1], rows[j + 1], rows[k + 1], a, b, c),
        middle(rows[i + 2], rows[j + 2], rows[k + 2], a, b, c),
    )  # fmt: skip


@routine
def sample(part, shared, at, world):
    """Write the predicted positions of samples among the unsorted particles, and the bounding box of the band."""
    coupling = world.solids
    count, capacity, before = world.sizes.particles, world.sizes.capacity, world.unsorted.before
    place, predicted_velocity, table = world.unsorted.position, world.unsorted.velocity, world.table
    corners, weights = coupling.points.corners, coupling.points.weights
    number, boxes = world.state.number, table.boxes
    lx, ly, lz, hx, hy, hz = LARGEST, LARGEST, LARGEST, -LARGEST, -LARGEST, -LARGEST
    for k in range(count * part // shared, count * (part + 1) // shared):
        s = np.int64(number[k]) - coupling.fluids
        if s >= 0:
            before[k], before[capacity + k], before[2 * capacity + k] = sample_position(
                s, corners, weights, coupling.places.before
            )
            place[k], place[capacity + k], place[2 * capacity + k] = sample_position(
                s, corners, weights, coupling.places.position
            )
            predicted_velocity[k], predicted_velocity[capacity + k], predicted_velocity[2 * capacity + k] = (
                0.0,
                0.0,
                0.0,
            )
        x, y, z = place[k], place[capacity + k], place[2 * capacity + k]
        if abs(x) < LARGEST and abs(y) < LARGEST and abs(z) < LARGEST:
            lx, ly, lz, hx, hy, hz = min(lx, x), min(ly, y), min(lz, z), max(hx, x), max(hy, y), max(hz, z)
    box = BOX * np.int64(part)
    boxes[box], boxes[box + 1], boxes[box + 2] = lx, ly, lz
    boxes[box + 3], boxes[box + 4], boxes[box + 5] = hx, hy, hz


@routine
def gather(part, shared, at, world):
    """Copy `kinds` into the order of cells, and store the slots of samples."""
    coupling = world.solids
    count, capacity = world.sizes.particles, world.sizes.capacity
    fluids, kinds = coupling.fluids, coupling.kinds
    number = world.in_order.number
    for i in range(count * part // shared, count * (part + 1) // shared):
        n = np.int64(number[i])
        for kind in range(KINDS):
            kinds[kind * capacity + i] = coupling.kinds_by_number[kind * count + n]
        if n >= fluids:
            coupling.slots[n - fluids] = np.int32(i)


@routine
def follow(part, shared, at, world):
    """Write the current positions of samples."""
    coupling, (place, _) = world.solids, positions(at.iteration, world)
    capacity = world.sizes.capacity
    slots, weights, position = coupling.slots, coupling.points.weights, coupling.places.position
    many = slots.size
    for s in range(many * part // shared, many * (part + 1) // shared):
        i = np.int64(slots[s])
        place[i], place[capacity + i], place[2 * capacity + i] = sample_position(
            s, coupling.points.corners, weights, position
        )


@routine
def push(part, shared, at, world):
    """Move the solids' particles by the shifts of their samples, summed in the order of the samples."""
    coupling = world.solids
    position, lightness, offsets = coupling.places.position, coupling.carriers.lightness, coupling.carriers.offsets
    weights, shift = coupling.carriers.weights, coupling.shift
    many, capacity = lightness.size, coupling.slots.size
    for k in range(many * part // shared, many * (part + 1) // shared):
        x, y, z = 0.0, 0.0, 0.0
        for e in range(offsets[k], offsets[k + 1]):
            s = np.int64(coupling.carriers.samples[e])
            x, y = carried_on(x, weights[e], shift[s]), carried_on(y, weights[e], shift[capacity + s])
            z = carried_on(z, weights[e], shift[2 * capacity + s])
        row = AXES * np.int64(k)
        position[row] = moved(position[row], lightness[k], x)
        position[row + 1] = moved(position[row + 1], lightness[k], y)
        position[row + 2] = moved(position[row + 2], lightness[k], z)


@routine
def rows_of(part, scratch):
    """Return the SUMS rows of a band."""
    at = np.int64(part) * (SUMS * LANES)
    return (
        row_at(scratch, at), row_at(scratch, at + LANES), row_at(scratch, at + 2 * LANES),
        row_at(scratch, at + 3 * LANES), row_at(scratch, at + 4 * LANES),
    )  # fmt: skip


@routine
def factors(part, shared, at, world):
    """Evaluate the neighbour factors of the constraint; 0 for samples."""
    coupling, scratch, parameters, fluids = world.solids, world.solids.sums, world.parameters, world.fluids
    count, capacity, in_order = world.sizes.particles, world.sizes.capacity, world.in_order
    factor, wall, longest = world.work.factor, world.work.wall, world.lists.longest
    entries = world.lists.entries
    first, kinds, place, numbers, fluid = (
        coupling.fluids,
        coupling.kinds,
        in_order.position,
        in_order.number,
        in_order.fluid,
    )
    _, end, _ = instants(at.number, parameters)
    gx, gy, gz, squares, wall_part = rows_of(part, scratch)
    slices = (count + LANES - 1) // LANES
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            gx[lane], gy[lane], gz[lane], squares[lane] = 0.0, 0.0, 0.0, 0.0
        gradients(
            longest[s], base, row_at(entries, base * FEATURE.neighbours), vector_at(place, capacity, 0),
            vector_at(place, capacity, base), pairs_of(parameters), kinds, row_at(kinds, K_LIGHTNESS * capacity),
            (gx, gy, gz, squares),
        )  # fmt: skip
        if FEATURE.walls:
            wall_rows(end, world, vector_at(place, capacity, base), wall_part, vector_at(wall, capacity, base))
        factor_rows(
            parameters.relaxation, parameters.softness, row_at(fluid, base), fluids, (gx, gy, gz, squares),
            vector_at(wall, capacity, base), row_at(factor, base), row_at(world.work.multiplier, base),
        )  # fmt: skip
        for i in range(base, min(base + LANES, count)):
            if numbers[i] >= first:
                factor[i] = 0.0


@routine
def constrain(part, shared, at, world):
    """Evaluate the constraints, and the changes of their multipliers; 0 for samples."""
    coupling, scratch, parameters = world.solids, world.solids.sums, world.parameters
    place, _ = positions(at.iteration, world)
    count, capacity, multiplier = world.sizes.particles, world.sizes.capacity, world.work.multiplier
    delta, error, wall, lists = world.work.delta, world.work.error, world.work.wall, world.lists
    first, kinds, numbers = coupling.fluids, coupling.kinds, world.in_order.number
    longest, entries, slices = lists.longest, lists.entries, (count + LANES - 1) // LANES
    _, end, _ = instants(at.number, parameters)
    total, _, _, _, wall_part = rows_of(part, scratch)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            total[lane] = 0.0
        densities(
            longest[s], row_at(entries, base * FEATURE.neighbours), vector_at(place, capacity, 0),
            vector_at(place, capacity, base), parameters.inverse_support, kinds, total,
        )  # fmt: skip
        if FEATURE.walls:
            wall_rows(end, world, vector_at(place, capacity, base), wall_part, vector_at(wall, capacity, base))
        relax_rows(
            parameters.lattice_sum, parameters.density_scale, total, wall_part, row_at(world.work.factor, base),
            row_at(multiplier, base), row_at(delta, base), row_at(error, base),
        )  # fmt: skip
        for i in range(base, min(base + LANES, count)):
            if numbers[i] >= first:
                error[i], delta[i], multiplier[i] = 0.0, 0.0, 0.0


@routine
def correct(part, shared, at, world):
    """Correct the positions of an iteration; store the shifts of samples."""
    coupling, scratch, parameters, fluids = world.solids, world.solids.sums, world.parameters, world.fluids
    place, there = positions(at.iteration, world)
    count, capacity, in_order, delta = world.sizes.particles, world.sizes.capacity, world.in_order, world.work.delta
    wall, lists = world.work.wall, world.lists
    first, kinds, slots, shift = coupling.fluids, coupling.kinds, coupling.slots, coupling.shift
    before, numbers, fluid = in_order.before, in_order.number, in_order.fluid
    longest, entries, slices = lists.longest, lists.entries, (count + LANES - 1) // LANES
    (ax, ay, az, _, _), many = rows_of(part, scratch), slots.size
    grip = row_at(kinds, K_GRIP * capacity)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            ax[lane], ay[lane], az[lane] = 0.0, 0.0, 0.0
        corrections(
            longest[s], base, row_at(entries, base * FEATURE.neighbours), vector_at(place, capacity, 0),
            (delta, kinds, grip), vector_at(place, capacity, base),
            (row_at(delta, base), row_at(kinds, base), row_at(grip, base)), pairs_of(parameters), (ax, ay, az),
        )  # fmt: skip
        for lane in range(min(LANES, count - base)):
            i = base + lane
            entry_row = row_at(entries, base * FEATURE.neighbours + lane)
            cx, cy, cz = frictions(i, entry_row, place, world, (ax[lane], ay[lane], az[lane]))
            px, py, pz = place[i], place[capacity + i], place[2 * capacity + i]
            sample = np.int64(numbers[i]) - first
            if sample >= 0:
                shift[sample], shift[many + sample], shift[2 * many + sample] = cx, cy, cz
            else:
                weight = fluids[row_of(fluid, i) + F_WEIGHT]
                if FEATURE.walls:
                    cx, cy = wall_added(cx, delta[i], wall[i]), wall_added(cy, delta[i], wall[capacity + i])
                    cz = wall_added(cz, delta[i], wall[2 * capacity + i])
                px, py, pz = moved(px, weight, cx), moved(py, weight, cy), moved(pz, weight, cz)
                if FEATURE.colliders:
                    a = before[i], before[capacity + i], before[2 * capacity + i]
                    (px, py, pz), _ = collide_mass(
                        world.bodies, world.kinds, at.number, parameters, a, (px, py, pz), (0.0, 0.0, 0.0)
                    )  # fmt: skip
            there[i], there[capacity + i], there[2 * capacity + i] = px, py, pz
