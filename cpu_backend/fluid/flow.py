"""Emitters and sinks on CPU threads (model/fluid/plan.py, 0 and 2).

Active particles are first in the state's arrays. fluid/arrays.py describes the arrays `flow`.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.fluid.phases import cells_in
from softlab.model.base.variant import routine
from softlab.model.fluid.flow import (
    E_BEFORE,
    E_COUNT,
    E_DISTANCE,
    E_FIRST,
    E_FLUID,
    E_RATE,
    E_SINCE,
    E_STOP,
    E_VX,
    E_VY,
    E_VZ,
    E_X,
    E_Y,
    E_Z,
    EMITTER_FIELDS,
    S_KIND,
    S_RADIUS,
    S_U,
    S_V,
    S_W,
    S_X,
    S_Y,
    S_Z,
    SINK_FIELDS,
    SINK_SHAPES,
)
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.fluid.flow import begun, behind, emitted, in_box, in_sphere, passed

AXES = 3
BOX, SPHERE, _ = range(len(SINK_SHAPES))
GONE = -1  # the cell of a removed particle


@routine
def free(n, end, there):
    """Return the first inactive number from n to before `end`, or `end`."""
    while n < end and there[n] != 0:
        n += 1
    return n


@routine
def put_particle(slot, n, fluid_number, capacity, state, row, points, q, layers, k):
    """Write particle n, of layer k at point q of a nozzle, into slot `slot` of the state."""
    position, velocity, number, fluid = state
    distance, at = row[E_DISTANCE], 3 * q
    position[slot] = emitted(points[at], row[E_X], layers, k, distance)
    position[capacity + slot] = emitted(points[at + 1], row[E_Y], layers, k, distance)
    position[2 * capacity + slot] = emitted(points[at + 2], row[E_Z], layers, k, distance)
    velocity[slot], velocity[capacity + slot], velocity[2 * capacity + slot] = row[E_VX], row[E_VY], row[E_VZ]
    number[slot], fluid[slot] = np.int32(n), np.int32(fluid_number)


@routine
def emit_particles(at, world):
    """Emit the particles of a substep, by one thread."""
    capacity, state, flow, parameters = world.sizes.capacity, world.state, world.flow, world.parameters
    alive, starts, there, emitters = flow.particles, flow.starts, flow.active, flow.emitters
    clock = parameters.dt, parameters.first_step, parameters.first_time
    begin, end = instant(at.number, *clock), instant(at.number + 1, *clock)
    for e in range(emitters.size // EMITTER_FIELDS):
        row = row_at(emitters, np.int64(e * EMITTER_FIELDS))
        since, stop, before, rate = row[E_SINCE], row[E_STOP], row[E_BEFORE], row[E_RATE]
        layers = passed(end, since, stop, before, rate)
        first, last = np.int64(begun(passed(begin, since, stop, before, rate))), np.int64(begun(layers))
        if first >= last:
            continue
        fluid_index = np.int64(row[E_FLUID])
        n, place, count = np.int64(starts[fluid_index]), np.int64(row[E_FIRST]), np.int64(row[E_COUNT])
        for k in range(first, last):
            for q in range(place, place + count):
                n = free(n, starts[fluid_index + 1], there)
                if n == starts[fluid_index + 1]:
                    flow.missed[0] += 1
                else:
                    put_particle(alive[0], n, fluid_index, capacity, state, row, flow.points, q, layers, k)
                    there[n] = 1
                    alive[0] += 1


@routine
def is_in_sink(sink, x, y, z):
    """Return True if a position is inside the sink."""
    dx, dy, dz = x - sink[S_X], y - sink[S_Y], z - sink[S_Z]
    kind = np.int64(sink[S_KIND])
    if kind == BOX:
        return in_box(dx, dy, dz, sink[S_U], sink[S_V], sink[S_W])
    if kind == SPHERE:
        return in_sphere(dx, dy, dz, sink[S_RADIUS])
    return behind(dx, dy, dz, sink[S_U], sink[S_V], sink[S_W])


@routine
def drain(part, shared, at, world):
    """Assign the cell GONE to the particles of a band that a sink removes."""
    count, capacity, unsorted, table = world.sizes.particles, world.sizes.capacity, world.unsorted, world.table
    place, number, cell, there, sinks = (
        unsorted.position,
        world.state.number,
        table.cell,
        world.flow.active,
        world.flow.sinks,
    )
    for k in range(count * part // shared, count * (part + 1) // shared):
        for s in range(sinks.size // SINK_FIELDS):
            sink = row_at(sinks, np.int64(s * SINK_FIELDS))
            if cell[k] != GONE and is_in_sink(sink, place[k], place[capacity + k], place[2 * capacity + k]):
                cell[k], there[number[k]] = np.int32(GONE), 0


@routine
def rest(part, shared, at, world):
    """Update the number of active particles, by one thread."""
    if part == 0:
        _, _, (nx, ny, nz) = cells_in(shared, world)
        world.flow.particles[0] = world.table.starts[nx * ny * nz]


@routine
def emit(part, shared, at, world):
    if part == 0:
        emit_particles(at, world)
