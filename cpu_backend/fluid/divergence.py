"""The phases of a substep of the scheme `divergence-free` on CPU threads, one band at a time
(model/fluid/divergence_plan.py).

`at` and `world` are At and Fluid of arrays.py. This scheme uses some of its arrays differently: `meant` are the
velocities that are read of neighbours; `before`, after the sort, are the shifts; the third group of the unsorted planes
are the last iterate, the multipliers of the second solve, and the target of the solves. From `accelerate` on, the
velocities are in the state, where they also end.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass, instants
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.cells import row_of
from softlab.cpu_backend.fluid.constraint import find, pairs_of
from softlab.cpu_backend.fluid.divergence_pairs import approaches
from softlab.cpu_backend.fluid.impact import settled
from softlab.cpu_backend.fluid.pairs import corrections, densities
from softlab.cpu_backend.fluid.quads import LANES, QUAD, QUADS
from softlab.cpu_backend.fluid.rows import numbers_of, sums_of, vector_at
from softlab.cpu_backend.fluid.velocities import shape_at
from softlab.cpu_backend.fluid.walls import wall_rows
from softlab.model.base.variant import FEATURE, routine
from softlab.model.fluid.parameters import F_CHANGE, F_SPEED, F_WEIGHT
from softlab.model.formulas.fluid.density import constraint, moved, wall_added
from softlab.model.formulas.fluid.divergence import (
    approach_of_wall,
    compressed,
    foreseen,
    gained,
    lead,
    led,
    pressed,
)
from softlab.model.formulas.fluid.motion import drifted, limited_change, slowed, speed_of


@routine
def approach(s, many, world, vector, total):
    """Add the contribution of a vector field to the rate of C, summed over the neighbours of slice s, to `total`."""
    capacity, lists = world.sizes.capacity, world.lists
    base, place = np.int64(s) * LANES, world.in_order.position
    for lane in range(LANES):
        total[lane] = 0.0
    approaches(
        many, base, row_at(lists.entries, base * FEATURE.neighbours), vector_at(place, capacity, 0),
        vector_at(vector, capacity, 0), vector_at(place, capacity, base), vector_at(vector, capacity, base),
        pairs_of(world.parameters), total,
    )  # fmt: skip


@routine
def rest_of(i, capacity, wall, vector, total):
    """Return the sum of particle i including the contribution of walls."""
    if FEATURE.walls:
        return approach_of_wall(
            total,
            wall[i],
            wall[capacity + i],
            wall[2 * capacity + i],
            vector[i],
            vector[capacity + i],
            vector[2 * capacity + i],
        )
    return total


@routine
def shape(part, shared, at, world):
    """Compute normals and vorticity at the positions at the substep's start."""
    shape_at(world.in_order.position, part, shared, world)


@routine
def survey(part, shared, at, world):
    """Evaluate the constraints and the target of the first solve."""
    parameters = world.parameters
    count, capacity, unsorted = world.sizes.particles, world.sizes.capacity, world.unsorted
    in_order, error, wall, lists = world.in_order, world.work.error, world.work.wall, world.lists
    scratch = world.scratch.sums
    place, velocity, target = (
        in_order.position,
        in_order.velocity,
        row_at(unsorted.velocity, 2 * np.int64(capacity)),
    )
    longest, slices = lists.longest, (count + LANES - 1) // LANES
    begin, end, _ = instants(at.number, parameters)
    total, coming, wall_part, earlier, wx, wy = sums_of(part, scratch)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            total[lane] = 0.0
        densities(
            longest[s], row_at(lists.entries, base * FEATURE.neighbours), row_at(place, QUADS * capacity),
            numbers_of(part, scratch), vector_at(place, capacity, base), pairs_of(parameters), total,
        )  # fmt: skip
        approach(s, longest[s], world, velocity, coming)
        for lane in range(LANES):
            wall_part[lane], earlier[lane] = 0.0, 0.0
        if FEATURE.walls:
            position_rows, (_, _, wz, _) = vector_at(place, capacity, base), numbers_of(part, scratch)
            wall_rows(end, world, position_rows, wall_part, vector_at(wall, capacity, base))
            if FEATURE.moving:
                wall_rows(begin, world, position_rows, earlier, (wx, wy, wz))
        for lane in range(min(LANES, count - base)):
            i, came = base + lane, 0.0
            if FEATURE.moving:
                came = wall_part[lane] - earlier[lane]
            error[i] = constraint(total[lane], parameters.lattice_sum, parameters.density_scale, wall_part[lane])
            a = rest_of(i, capacity, wall, velocity, coming[lane])
            target[i] = compressed(error[i], a, parameters.dt, came)


@routine
def find_and_survey(part, shared, at, world):
    find(part, shared, at, world)
    survey(part, shared, at, world)


@routine
def foresee(part, shared, at, world):
    """Evaluate the target of the second solve."""
    count, capacity, unsorted, wall = world.sizes.particles, world.sizes.capacity, world.unsorted, world.work.wall
    velocity, target = world.state.velocity, row_at(unsorted.velocity, 2 * np.int64(capacity))
    (coming, _, _, _, _, _), slices = sums_of(part, world.scratch.sums), (count + LANES - 1) // LANES
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        approach(s, world.lists.longest[s], world, velocity, coming)
        for lane in range(min(LANES, count - np.int64(s) * LANES)):
            i = np.int64(s) * LANES + lane
            target[i] = foreseen(
                world.work.error[i], rest_of(i, capacity, wall, velocity, coming[lane]), world.parameters.dt
            )


@routine
def relax(part, shared, at, world):
    """Evaluate the changes of the multipliers, and the new multipliers."""
    count, capacity, unsorted = world.sizes.particles, world.sizes.capacity, world.unsorted
    in_order, delta = world.in_order, world.work.delta
    shift, iterate = in_order.before, row_at(unsorted.velocity, np.int64(0))
    ahead, target = row_at(unsorted.velocity, np.int64(capacity)), row_at(unsorted.velocity, 2 * np.int64(capacity))
    if not at.second:
        ahead = row_at(world.work.multiplier, np.int64(0))
    (coming, _, _, _, _, _), slices = sums_of(part, world.scratch.sums), (count + LANES - 1) // LANES
    quads = row_at(in_order.position, QUADS * np.int64(capacity))
    onward = lead(at.iteration, at.iterations)
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        if at.iteration > 0:
            approach(s, world.lists.longest[s], world, shift, coming)
        for lane in range(min(LANES, count - np.int64(s) * LANES)):
            i = np.int64(s) * LANES + lane
            c, before, last = target[i], 0.0, 0.0
            if at.iteration > 0:
                before, last = ahead[i], iterate[i]
                c = c + rest_of(i, capacity, world.work.wall, shift, coming[lane])
            relaxed = pressed(before, world.work.factor[i], c)
            ahead[i] = led(relaxed, last, onward)
            delta[i], iterate[i] = ahead[i] - before, relaxed
            quads[QUAD * i + 3] = delta[i]


@routine
def push(part, shared, at, world):
    """Add the effect of the changed multipliers to the shifts."""
    parameters, fluids = world.parameters, world.fluids
    count, capacity, in_order, delta = world.sizes.particles, world.sizes.capacity, world.in_order, world.work.delta
    wall, lists, scratch = world.work.wall, world.lists, world.scratch.sums
    shift, place, fluid = in_order.before, in_order.position, in_order.fluid
    (ax, ay, az, _, _, _), slices = sums_of(part, scratch), (count + LANES - 1) // LANES
    for s in range(slices * part // shared, slices * (part + 1) // shared):
        base = np.int64(s) * LANES
        for lane in range(LANES):
            ax[lane], ay[lane], az[lane] = 0.0, 0.0, 0.0
        corrections(
            lists.longest[s], base, row_at(lists.entries, base * FEATURE.neighbours), row_at(place, QUADS * capacity),
            numbers_of(part, scratch), vector_at(place, capacity, base), row_at(delta, base), pairs_of(parameters),
            (ax, ay, az),
        )  # fmt: skip
        for lane in range(min(LANES, count - base)):
            i = base + lane
            x, y, z, weight = ax[lane], ay[lane], az[lane], fluids[row_of(fluid, i) + F_WEIGHT]
            if FEATURE.walls:
                x, y = wall_added(x, delta[i], wall[i]), wall_added(y, delta[i], wall[capacity + i])
                z = wall_added(z, delta[i], wall[2 * capacity + i])
            ex, ey, ez = 0.0, 0.0, 0.0
            if at.iteration > 0:
                ex, ey, ez = shift[i], shift[capacity + i], shift[2 * capacity + i]
            shift[i], shift[capacity + i] = moved(ex, weight, x), moved(ey, weight, y)
            shift[2 * capacity + i] = moved(ez, weight, z)


@routine
def corrected_velocity(i, capacity, velocity, shift, parameters, most):
    """Return the velocity of particle i after a solve."""
    rate, u, v, w = parameters.inverse_dt, velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
    a, b, c = (
        gained(u, shift[i], rate),
        gained(v, shift[capacity + i], rate),
        gained(w, shift[2 * capacity + i], rate),
    )
    if FEATURE.limited_change:
        far = speed_of(a - u, b - v, c - w)
        return limited_change(a, u, far, most), limited_change(b, v, far, most), limited_change(c, w, far, most)
    return a, b, c


@routine
def take_up(part, shared, at, world):
    """Update the velocities after the first solve."""
    parameters, fluids = world.parameters, world.fluids
    count, capacity, in_order = world.sizes.particles, world.sizes.capacity, world.in_order
    shift, velocity, fluid = in_order.before, in_order.velocity, in_order.fluid
    for i in range(count * part // shared, count * (part + 1) // shared):
        u, v, w = corrected_velocity(i, capacity, velocity, shift, parameters, fluids[row_of(fluid, i) + F_CHANGE])
        velocity[i], velocity[capacity + i], velocity[2 * capacity + i] = u, v, w


@routine
def move(part, shared, at, world):
    """Write the new state and the sum of the multipliers of both solves."""
    parameters, fluids, bodies, kinds = world.parameters, world.fluids, world.bodies, world.kinds
    count, capacity, in_order = world.sizes.particles, world.sizes.capacity, world.in_order
    position, velocity, numbers, fluid = world.state
    shift, place, multiplier = in_order.before, in_order.position, world.work.multiplier
    second = row_at(world.unsorted.velocity, np.int64(capacity))
    for i in range(count * part // shared, count * (part + 1) // shared):
        row = row_of(in_order.fluid, i)
        mx, my, mz = velocity[i], velocity[capacity + i], velocity[2 * capacity + i]
        u, v, w = corrected_velocity(i, capacity, velocity, shift, parameters, fluids[row + F_CHANGE])
        speed, fastest, h = speed_of(u, v, w), fluids[row + F_SPEED], parameters.dt
        u, v, w = slowed(u, speed, fastest), slowed(v, speed, fastest), slowed(w, speed, fastest)
        bx, by, bz = place[i], place[capacity + i], place[2 * capacity + i]
        x, y, z = drifted(bx, u, h), drifted(by, v, h), drifted(bz, w, h)
        if FEATURE.colliders:
            before, corrected = (bx, by, bz), (mx, my, mz)
            u, v, w = settled(at, world, before, (u, v, w), corrected, second[i], fluids[row + F_WEIGHT])
            (x, y, z), (u, v, w) = collide_mass(
                bodies, kinds, at.number, parameters, (bx, by, bz), (x, y, z), (u, v, w)
            )
            speed = speed_of(u, v, w)
            u, v, w = slowed(u, speed, fastest), slowed(v, speed, fastest), slowed(w, speed, fastest)
        position[i], position[capacity + i], position[2 * capacity + i] = x, y, z
        velocity[i], velocity[capacity + i], velocity[2 * capacity + i] = u, v, w
        multiplier[i] = multiplier[i] + second[i]
        numbers[i] = in_order.number[i]
        if FEATURE.fluids:
            fluid[i] = in_order.fluid[i]
