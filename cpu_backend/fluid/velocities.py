"""The last phases of a fluid's substep on CPU threads: velocities (model/fluid/plan.py, 6 to 9)."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_row
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import AXES, row_of
from softlab.cpu_backend.fluid.constraint import sides_of
from softlab.cpu_backend.fluid.impact import impact_of, settled
from softlab.cpu_backend.fluid.phases import positions
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.rows import DOUBLE_BLOCKS, SINGLE_BLOCKS, sums_of, vector_at
from softlab.cpu_backend.fluid.smoothing import shapes, smooth
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.fluid.parameters import F_CHANGE, F_DRAG, F_SPEED, F_SURFACE_DRAG, F_WEIGHT
from softlab.model.formulas.fluid.motion import braked, limited_change, slowed, speed_of, velocity_of


@row_routine
def velocities(rate, fluid, fluids, place, before, predicted, sums):
    """Copy positions and compute velocities into `sums`."""
    (px, py, pz), (bx, by, bz), (predicted_u, predicted_v, predicted_w) = place, before, predicted
    x, y, z, u, v, w = sums
    for lane in range(LANES):
        x[lane], y[lane], z[lane] = px[lane], py[lane], pz[lane]
        a, b = velocity_of(px[lane], bx[lane], rate), velocity_of(py[lane], by[lane], rate)
        c = velocity_of(pz[lane], bz[lane], rate)
        if FEATURE.limited_change:
            ma, mb, mc = predicted_u[lane], predicted_v[lane], predicted_w[lane]
            far, most_change = speed_of(a - ma, b - mb, c - mc), fluids[row_of(fluid, lane) + F_CHANGE]
            a, b = limited_change(a, ma, far, most_change), limited_change(b, mb, far, most_change)
            c = limited_change(c, mc, far, most_change)
        u[lane], v[lane], w[lane] = a, b, c


@routine
def at_walls(base, at, world, sums):
    """Update the velocities (u, v, w) of a slice at (x, y, z) for impacts on colliders, without the rebound from walls."""
    capacity, in_order, fluids = world.sizes.capacity, world.in_order, world.fluids
    x, y, z, u, v, w = sums
    before, predicted_velocity = in_order.before, in_order.velocity
    for lane in range(min(LANES, world.sizes.particles - base)):
        i, row = base + lane, row_of(in_order.fluid, base + lane)
        b = before[i], before[capacity + i], before[2 * capacity + i]
        predicted = predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i]
        place, corrected, after = impact_of(
            at, world, b, predicted, (x[lane], y[lane], z[lane]), (u[lane], v[lane], w[lane]), fluids[row + F_CHANGE]
        )
        u[lane], v[lane], w[lane] = settled(
            at, world, place, after, corrected, world.work.multiplier[i], fluids[row + F_WEIGHT]
        )


@routine
def update(part, shared, at, world):
    """Derive velocities from positions and colliders, and write them into `predicted_velocity`, which no other
    phase reads."""
    parameters, (place, _), in_order = world.parameters, positions(at.iterations, world), world.in_order
    capacity, slices = world.sizes.capacity, (world.sizes.particles + LANES - 1) // LANES
    before, predicted_velocity, fluid = in_order.before, in_order.velocity, in_order.fluid
    sums, blocks = sums_of(part, world.scratch.sums), SINGLE_BLOCKS if FEATURE.single else DOUBLE_BLOCKS
    x, y, z, u, v, w = sums
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        velocities(
            parameters.inverse_dt, row_at(fluid, base), world.fluids, vector_at(place, capacity, base),
            vector_at(before, capacity, base), vector_at(predicted_velocity, capacity, base), sums,
        )  # fmt: skip
        if FEATURE.colliders:
            at_walls(base, at, world, sums)
            collide_row(
                world.bodies, world.kinds, at.number, parameters, blocks, before, base, capacity, x, np.int64(0), LANES
            )
        for lane in range(LANES):
            i = base + lane
            place[i], place[capacity + i], place[2 * capacity + i] = x[lane], y[lane], z[lane]
            predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i] = (
                u[lane],
                v[lane],
                w[lane],
            )


@routine
def shape(part, shared, at, world):
    """Compute normals and vorticity at the new positions."""
    place, _ = positions(at.iterations, world)
    shape_at(place, part, shared, world)


@routine
def shape_at(place, part, shared, world):
    """Write normals and vorticity at the positions `place` into the unsorted planes of positions."""
    count, sides = world.sizes.particles, sides_of(world.parameters)
    for i in range(count * part // shared, count * (part + 1) // shared):
        entry_row = row_at(world.lists.entries, np.int64(i // LANES) * (LANES * FEATURE.neighbours) + i % LANES)
        shapes(i, entry_row, place, world, sides)


@routine
def finish(part, shared, at, world):
    """Write the new state: velocities after neighbours, drag and the speed limit."""
    parameters, fluids, (place, _) = world.parameters, world.fluids, positions(at.iterations, world)
    count, capacity, in_order = world.sizes.particles, world.sizes.capacity, world.in_order
    position, velocity, number, fluid = world.state
    sides, predicted_velocity, error = sides_of(parameters), in_order.velocity, world.work.error
    for i in range(count * part // shared, count * (part + 1) // shared):
        row = row_of(in_order.fluid, i)
        if FEATURE.smoothing:
            entry_row = row_at(world.lists.entries, np.int64(i // LANES) * (LANES * FEATURE.neighbours) + i % LANES)
            u, v, w = smooth(i, entry_row, place, world, sides)
        else:
            u, v, w = predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i]
        if FEATURE.drag:
            h, drag, surface = parameters.dt, fluids[row + F_DRAG], fluids[row + F_SURFACE_DRAG]
            u, v = braked(u, h, drag, surface, error[i]), braked(v, h, drag, surface, error[i])
            w = braked(w, h, drag, surface, error[i])
        speed, fastest = speed_of(u, v, w), fluids[row + F_SPEED]
        velocity[i], velocity[capacity + i] = slowed(u, speed, fastest), slowed(v, speed, fastest)
        velocity[2 * capacity + i] = slowed(w, speed, fastest)
        for axis in range(AXES):
            position[axis * capacity + i] = place[axis * capacity + i]
        number[i] = in_order.number[i]
        if FEATURE.fluids:
            fluid[i] = in_order.fluid[i]
