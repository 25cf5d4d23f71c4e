"""The neighbour sum that only the scheme `divergence-free` has, LANES particles at a time, and its phases `gather` and
`accelerate` (model/fluid/divergence_plan.py, 1, 4, 8)."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import particle_force
from softlab.cpu_backend.fluid.cells import AXES, BOX, LARGEST, row_of
from softlab.cpu_backend.fluid.constraint import sides_of
from softlab.cpu_backend.fluid.lists import wrap
from softlab.cpu_backend.fluid.quads import LANES
from softlab.cpu_backend.fluid.smoothing import smooth
from softlab.model.base.variant import FEATURE, routine, row_routine
from softlab.model.fluid.parameters import F_BUOYANCY, F_DRAG, F_SPEED, F_SURFACE_DRAG
from softlab.model.formulas.fluid.density import apart, slope, squared
from softlab.model.formulas.fluid.divergence import approach_added
from softlab.model.formulas.fluid.motion import accelerated, braked, buoyant, slowed, speed_of, wrapped_offset


@row_routine
def approaches(many, first, entries, place, vector, centre, centre_vector, pairs, total):
    """Add the contribution of a vector of each particle to the constraints to `total`. The arguments are those of
    cpu_backend/fluid/pairs.py."""
    (x, y, z), (u, v, w), (sides, support, inverse, scale, _, _) = place, vector, pairs
    (centre_x, centre_y, centre_z), (centre_u, centre_v, centre_w) = centre, centre_vector
    for k in range(many):
        for lane in range(LANES):
            j = entries[k * LANES + lane]
            dx, dy, dz = wrap(centre_x[lane] - x[j], centre_y[lane] - y[j], centre_z[lane] - z[j], sides)
            dy = apart(dy, squared(dx, dy, dz), support, first + lane < j)
            s = slope(squared(dx, dy, dz), inverse, scale)
            total[lane] = approach_added(
                total[lane], s, dx, dy, dz, centre_u[lane] - u[j], centre_v[lane] - v[j], centre_w[lane] - w[j]
            )


@routine
def gather(part, shared, at, world):
    """Copy the state, wrapped into the periodic box, and write the bounding box of the band."""
    parameters = world.parameters
    count, capacity, position = world.sizes.particles, world.sizes.capacity, world.state.position
    place, predicted_velocity = world.unsorted.position, world.unsorted.velocity
    lx, ly, lz, hx, hy, hz = LARGEST, LARGEST, LARGEST, -LARGEST, -LARGEST, -LARGEST
    for k in range(count * part // shared, count * (part + 1) // shared):
        x, y, z = position[k], position[capacity + k], position[2 * capacity + k]
        if FEATURE.repeats:
            x = x + wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
            y = y + wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
            z = z + wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
        place[k], place[capacity + k], place[2 * capacity + k] = x, y, z
        for axis in range(AXES):
            predicted_velocity[axis * capacity + k] = world.state.velocity[axis * capacity + k]
        if abs(x) < LARGEST and abs(y) < LARGEST and abs(z) < LARGEST:
            lx, ly, lz, hx, hy, hz = min(lx, x), min(ly, y), min(lz, z), max(hx, x), max(hy, y), max(hz, z)
    box, boxes = BOX * np.int64(part), world.table.boxes
    boxes[box], boxes[box + 1], boxes[box + 2] = lx, ly, lz
    boxes[box + 3], boxes[box + 4], boxes[box + 5] = hx, hy, hz


@routine
def forced(number, row, step, parameters, fluids, integers):
    """Return the acceleration of a particle by gravity and the forces on single particles [m/s^2]."""
    ax, ay, az = 0.0, 0.0, 0.0
    if FEATURE.gravity:
        ay = buoyant(parameters.gravity, fluids[row + F_BUOYANCY])
    if FEATURE.axes == AXES:
        return particle_force((ax, ay, az), np.int64(number), 1.0, parameters, integers, step)
    ax, ay = particle_force((ax, ay), np.int64(number), 1.0, parameters, integers, step)
    return ax, ay, az


@routine
def accelerate(part, shared, at, world):
    """Apply neighbours, drag and forces to the velocities, and write them into the state."""
    parameters, fluids = world.parameters, world.fluids
    count, capacity, in_order, work = world.sizes.particles, world.sizes.capacity, world.in_order, world.work
    place, predicted_velocity, velocity, error = (
        in_order.position,
        in_order.velocity,
        world.state.velocity,
        work.error,
    )
    h, sides = parameters.dt, sides_of(parameters)
    for i in range(count * part // shared, count * (part + 1) // shared):
        row = row_of(in_order.fluid, i)
        if FEATURE.smoothing:
            entry_row = row_at(world.lists.entries, np.int64(i // LANES) * (LANES * FEATURE.neighbours) + i % LANES)
            u, v, w = smooth(i, entry_row, place, world, sides)
        else:
            u, v, w = predicted_velocity[i], predicted_velocity[capacity + i], predicted_velocity[2 * capacity + i]
        if FEATURE.drag:
            drag, surface = fluids[row + F_DRAG], fluids[row + F_SURFACE_DRAG]
            u, v = braked(u, h, drag, surface, error[i]), braked(v, h, drag, surface, error[i])
            w = braked(w, h, drag, surface, error[i])
        ax, ay, az = forced(in_order.number[i], row, at.step, parameters, fluids, world.integers)
        u, v, w = accelerated(u, h, ax), accelerated(v, h, ay), accelerated(w, h, az)
        speed, fastest = speed_of(u, v, w), fluids[row + F_SPEED]
        if speed > fastest:
            world.lists.counts[shared + part] += 1
        velocity[i], velocity[capacity + i] = slowed(u, speed, fastest), slowed(v, speed, fastest)
        velocity[2 * capacity + i] = slowed(w, speed, fastest)
