"""Cell table of a fluid, and the sort by cell and number, for CPU threads (model/fluid/plan.py, 1 and 2)."""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.contact.colliders import collide_mass
from softlab.cpu_backend.core.own_forces import particle_force
from softlab.cpu_backend.fluid.quads import QUAD, QUADS
from softlab.model.base.variant import FEATURE, routine
from softlab.model.fluid.parameters import F_BUOYANCY, F_SPEED, FLUID_FIELDS
from softlab.model.formulas.fluid.cells import cell_of, cells_along, fits, halved
from softlab.model.formulas.fluid.motion import accelerated, buoyant, drifted, slowed, speed_of, wrapped_offset

AXES = 3
BOX = 2 * AXES  # numbers in a band's box: the lowest corner, the highest one
TABLE = 3  # integers of the table: counts along x, y, z
LARGEST = 1e30  # limit of a box: particles farther off, or not finite, do not extend it


@routine
def row_of(fluid, k):
    """Return the offset of the row of the fluid of particle k."""
    return FLUID_FIELDS * np.int64(fluid[k]) if FEATURE.fluids else np.int64(0)


@routine
def predict_particles(band, first, last, at, world):
    """Predict the positions of the particles `first` to before `last`, move them out of the colliders of that substep, and
    write the bounding box of the band. Return how many particles the speed limit slowed."""
    parameters, fluids, capacity, boxes = world.parameters, world.fluids, world.sizes.capacity, world.table.boxes
    position, velocity, number, fluid = world.state
    before, place, predicted_velocity = world.unsorted
    lx, ly, lz, hx, hy, hz = LARGEST, LARGEST, LARGEST, -LARGEST, -LARGEST, -LARGEST
    h, limited = parameters.dt, 0
    for k in range(first, last):
        row = row_of(fluid, k)
        ax, ay, az = 0.0, 0.0, 0.0
        if FEATURE.gravity:
            ay = buoyant(parameters.gravity, fluids[row + F_BUOYANCY])
        if FEATURE.axes == AXES:
            ax, ay, az = particle_force((ax, ay, az), np.int64(number[k]), 1.0, parameters, world.integers, at.step)
        else:
            ax, ay = particle_force((ax, ay), np.int64(number[k]), 1.0, parameters, world.integers, at.step)
        u = accelerated(velocity[k], h, ax)
        v = accelerated(velocity[capacity + k], h, ay)
        w = accelerated(velocity[2 * capacity + k], h, az)
        speed, most = speed_of(u, v, w), fluids[row + F_SPEED]
        if speed > most:
            limited += 1
        u, v, w = slowed(u, speed, most), slowed(v, speed, most), slowed(w, speed, most)
        ax, ay, az = position[k], position[capacity + k], position[2 * capacity + k]
        x, y, z = drifted(ax, u, h), drifted(ay, v, h), drifted(az, w, h)
        if FEATURE.repeats:
            s = wrapped_offset(x, parameters.low_x, parameters.high_x, parameters.side_x)
            x, ax = x + s, ax + s
            s = wrapped_offset(y, parameters.low_y, parameters.high_y, parameters.side_y)
            y, ay = y + s, ay + s
            s = wrapped_offset(z, parameters.low_z, parameters.high_z, parameters.side_z)
            z, az = z + s, az + s
        if FEATURE.colliders:
            (x, y, z), _ = collide_mass(
                world.bodies, world.kinds, at.number, parameters, (ax, ay, az), (x, y, z), (u, v, w)
            )
        predicted_velocity[k], predicted_velocity[capacity + k], predicted_velocity[2 * capacity + k] = u, v, w
        before[k], before[capacity + k], before[2 * capacity + k] = ax, ay, az
        place[k], place[capacity + k], place[2 * capacity + k] = x, y, z
        if abs(x) < LARGEST and abs(y) < LARGEST and abs(z) < LARGEST:
            lx, ly, lz, hx, hy, hz = min(lx, x), min(ly, y), min(lz, z), max(hx, x), max(hy, y), max(hz, z)
    box = BOX * np.int64(band)
    boxes[box], boxes[box + 1], boxes[box + 2] = lx, ly, lz
    boxes[box + 3], boxes[box + 4], boxes[box + 5] = hx, hy, hz
    return limited


@routine
def joined(bands, boxes, axis):
    low, high = LARGEST, -LARGEST
    for band in range(bands):
        low, high = min(low, boxes[BOX * band + axis]), max(high, boxes[BOX * band + AXES + axis])
    return low, high


@routine
def along(bands, boxes, axis, low, side, inverse, inverse_side, cells):
    """Return (lowest position, inverse cell edge, count, highest position) along an axis."""
    if side > 0.0:
        return low, inverse_side, np.int64(cells), low
    lowest, highest = joined(bands, boxes, axis)
    return lowest, inverse, np.int64(cells_along(lowest, highest, inverse)), highest


@routine
def span(bands, boxes, most, parameters):
    """Return (lowest positions, inverse cell edges, counts), three of each."""
    p, inverse = parameters, parameters.inverse_cell
    lx, ix, nx, hx = along(bands, boxes, 0, p.low_x, p.side_x, inverse, p.inverse_side_x, p.cells_x)
    ly, iy, ny, hy = along(bands, boxes, 1, p.low_y, p.side_y, inverse, p.inverse_side_y, p.cells_y)
    lz, iz, nz, hz = along(bands, boxes, 2, p.low_z, p.side_z, inverse, p.inverse_side_z, p.cells_z)
    while not fits(nx, ny, nz, most):
        wx, wy, wz = nx, ny, nz
        if p.side_x > 0.0:
            wx = np.int64(0)
        if p.side_y > 0.0:
            wy = np.int64(0)
        if p.side_z > 0.0:
            wz = np.int64(0)
        if max(wx, wy, wz) <= 1:
            break
        if wx >= wy and wx >= wz:
            ix = halved(ix)
            nx = np.int64(cells_along(lx, hx, ix))
        elif wy >= wz:
            iy = halved(iy)
            ny = np.int64(cells_along(ly, hy, iy))
        else:
            iz = halved(iz)
            nz = np.int64(cells_along(lz, hz, iz))
    return (lx, ly, lz), (ix, iy, iz), (nx, ny, nz)


@routine
def enter_particles(first, last, capacity, place, low, inverse, counts, cell):
    nx, ny, nz = counts
    for k in range(first, last):
        i = np.int64(cell_of(place[k], low[0], inverse[0], nx))
        j = np.int64(cell_of(place[capacity + k], low[1], inverse[1], ny))
        l = np.int64(cell_of(place[2 * capacity + k], low[2], inverse[2], nz))  # noqa: E741
        cell[k] = np.int32((l * ny + j) * nx + i)


@routine
def tally_cells(low, high, count, cell, starts):
    """Count the particles in each cell. Returns their sum."""
    inside = 0
    for c in range(low, high):
        starts[c] = 0
    for k in range(count):
        cell_number = np.int64(cell[k])
        if low <= cell_number < high:
            starts[cell_number] += 1
            inside += 1
    return inside


@routine
def put_in_order(low, high, first, world):
    """Write the particles in the order of cells; `first` is the number of particles in the cells before `low`.

    Afterwards starts[c] is the first particle of cell c. Returns the end of the last cell.
    """
    state, number, table = world.state, world.state.number, world.table
    cell, starts, order = table.cell, table.starts, table.order
    count, capacity = world.sizes.particles, world.sizes.capacity
    before, place, predicted_velocity = world.unsorted
    new_before, new_place, new_predicted_velocity, new_number, new_fluid = world.in_order
    end = np.int64(first)
    for c in range(low, high):
        inside = starts[c]
        starts[c] = np.int32(end)
        end += np.int64(inside)
    for k in range(count):
        cell_number = np.int64(cell[k])
        if low <= cell_number < high:
            order[starts[cell_number]] = np.int32(k)
            starts[cell_number] += 1
    start = np.int64(first)
    for c in range(low, high):
        last = np.int64(starts[c])
        for n in range(start + 1, last):
            one, q = order[n], n
            while q > start and number[order[q - 1]] > number[one]:
                order[q] = order[q - 1]
                q -= 1
            order[q] = one
        starts[c] = np.int32(start)
        start = last
    for axis in range(AXES):
        at, quad = axis * capacity, QUADS * capacity + axis
        for q in range(first, end):
            old = at + np.int64(order[q])
            new_before[at + q] = before[old]
            new_place[at + q] = new_place[quad + QUAD * q] = place[old]
            new_predicted_velocity[at + q] = predicted_velocity[old]
    for q in range(first, end):
        new_number[q] = number[order[q]]
        if FEATURE.fluids:
            new_fluid[q] = state.fluid[order[q]]
    return end
