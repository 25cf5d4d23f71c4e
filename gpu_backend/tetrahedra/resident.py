"""The kernel `resident` of tetrahedra: bodies of voxels on the chip, one slab per block, for all substeps of many
steps.

A block stores the vertices of its slab in shared memory, projects colour by colour with a barrier of its own threads
after each, and exchanges with its neighbours twice per sweep (slabs.py): each vertex of a common side is a message with
its tag (core/messages.py), sent as soon as it is known; no flags, and no barrier of all blocks. All blocks must run at
once, which a cooperative launch guarantees, and every wait has a timeout.

One message buffer per direction is enough. A slab sends downwards in a sweep only after it has received from the slab
below in the last one, which sent after it had received the downward messages; and likewise upwards.

Velocities are not stored: the end of a vertex's substep is the start of its next one.

The lower bound of a sweep is the path through one vertex: 40 tetrahedra of 8 voxels, one after the other, for which a
thread keeps the vertices of a voxel in registers (core/constraints.py); both exchanges with neighbours are a tenth of
that.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import predict, settle
from softlab.gpu_backend.core.blocks import PATIENCE, raise_flag, read_flag
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.constraints import constants_of, fetch, take, with_projection
from softlab.gpu_backend.core.device import ALIGNMENT, DeviceArray, simulated
from softlab.gpu_backend.core.forces import add_gravity, add_particle_force, particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.messages import receive, send
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.slabs import (
    ALL,
    BORDER_AFTER,
    BORDER_BEFORE,
    HEADER,
    LIST,
    LOCAL,
    MOST_THREADS,
    SHARED,
    STARTS,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, routine
from softlab.model.particles.constraints import Projection

scalar = Open("type of the numbers in shared memory")


class State(NamedTuple):
    """Positions and velocities, quads."""

    position: DeviceArray
    velocity: DeviceArray


class SlabArrays(NamedTuple):
    """`tables`, `early`, `colours`, `largest` of Slabs; their `size` constraints: `corners`, values, multipliers."""

    tables: DeviceArray
    corners: DeviceArray
    values: DeviceArray
    multipliers: DeviceArray
    early: np.int32
    colours: np.int32
    size: np.int32
    largest: np.int32


class Exchange(NamedTuple):
    """`messages` (3 borders * message_size,): downwards, upwards, downwards of old positions, with tags `epoch` + 1, + 2,
    ...; `failed` (1,) int32 is set to 1 by a block whose messages never arrive."""

    messages: DeviceArray
    borders: np.int32
    epoch: np.int32
    failed: DeviceArray


class Limits(NamedTuple):
    """Steps of a launch, substeps of a step, iterations of a substep."""

    steps: np.int64
    substeps: np.int64
    iterations: np.int32


class Sweep(NamedTuple):
    """Arguments of sweeps besides the vertices: the place of the starts of colours in `tables`, number of colours;
    `arrays`: (corners, values, multipliers) of `count` constraints; constants of the projection."""

    tables: DeviceArray
    starts: np.int32
    colours: np.int32
    arrays: tuple[DeviceArray, DeviceArray, DeviceArray]
    count: np.int32
    constants: tuple[Any, Any, Any]


@inlined_routine
def send_border(messages, at, quads, first, count, tag):
    """Send vertices `first` ... of the slab, in the messages from `at` on; by the threads of a block together."""
    n, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    while n < count:  # not a range: its number of iterations would be a quotient
        q = load_quad(quads, np.int32(first + n))
        send(messages, np.int32(at + n), q[0], q[1], q[2], tag)
        n = np.int32(n + threads)


@inlined_routine
def hear(messages, at, quads, first, count, tag, failed):
    """Wait for such messages, by the threads of a block together."""
    n, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    while n < count:
        x, y, z, here = receive(messages, np.int32(at + n), tag)
        checks = np.int32(0)
        while not here:
            checks += np.int32(1)
            if checks > PATIENCE or ((checks & 1023) == 0 and read_flag(failed, 0) != 0):
                raise_flag(failed, 0, np.int32(1))
                break
            x, y, z, here = receive(messages, np.int32(at + n), tag)
        vertex = np.int32(first + n)
        store_quad(quads, vertex, x, y, z, load_quad(quads, vertex)[3])
        n = np.int32(n + threads)


@inlined_routine
def begin(p, v, particle, world, step):
    """Return the prediction of one mass from its state."""
    ax, ay, az = add_gravity(0.0, 0.0, 0.0, world.parameters)
    ax, ay, az = add_particle_force(ax, ay, az, particle, p[3], world.parameters, world.integers, step)
    x, y, z = predict(p, v, ax, ay, az, world.parameters)
    return x, y, z, p[3]


@inlined_routine
def end(before, now, world, number):
    """Return (position, velocity) of one mass after substep `number`."""
    px, py, pz, vx, vy, vz = settle(before, now, world, number)
    return (px, py, pz, before[3]), (vx, vy, vz, 0.0)


@inlined_routine
def bounds(colour, inputs):
    """Return (first run of a colour, how many)."""
    starts, tables = inputs.starts, inputs.tables
    start = tables[np.uint32(starts + colour)]
    return start, np.int32(tables[np.uint32(starts + colour + 1)] - start)


@inlined_routine
def fetched(start, runs, inputs):
    """Load the data of a thread's first run; a thread without one loads another's, or the very first one."""
    corners, values, _ = inputs.arrays
    number = np.int32(start + min(np.int32(cuda.threadIdx.x), np.int32(runs - 1)))
    place = np.int32(np.int32(FEATURE.run - 1) * start + number)
    if runs == 0:
        number, place = np.int32(0), np.int32(0)
    return fetch(corners, values, number, place, inputs.count)


@inlined_routine
def ahead(colour, inputs):
    """Return (first run of a colour, how many, data of this thread's first one)."""
    start, runs = bounds(colour, inputs)
    return start, runs, fetched(start, runs, inputs)


@inlined_routine
def sweep(first, last, now, before, inputs, fresh, ready):
    """Project a block's runs of the colours `first` to before `last`; `ready` is `ahead` of the first one. Returns that of
    the next one."""
    start, runs, ready_values = ready
    corners, values, _ = inputs.arrays
    count = inputs.count
    for colour in range(first, last):
        following = np.int32(colour + 1) if colour + 1 < inputs.colours else np.int32(0)
        coming, many = bounds(following, inputs)
        n, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        while n < runs:
            place = np.int32(FEATURE.run * start + n)
            take(now, before, inputs.arrays, ready_values, place, runs, count, fresh, inputs.constants)
            n = np.int32(n + threads)
            if n < runs:
                ready_values = fetch(corners, values, np.int32(start + n), np.int32(FEATURE.run * start + n), count)
        start, runs = coming, many
        ready_values = fetched(start, runs, inputs)  # loaded while others are waited for
        cuda.syncthreads()
    return start, runs, ready_values


@routine
def tetrahedra_resident(state, new_state, slabs, exchange, record, bodies, integers, counter, limits):
    """Do `limits.steps` steps of the bodies of one set, from the old state to the new one. Launched cooperatively, one block
    per slab."""
    shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
    capacity = SIZE * slabs.largest
    tables, colours, early = slabs.tables, slabs.colours, slabs.early
    messages, borders, failed = exchange.messages, exchange.borders, exchange.failed
    steps, substeps = limits.steps, limits.substeps
    now, before = shared[:capacity], shared[capacity : 2 * capacity]
    head = np.int32(cuda.blockIdx.x * HEADER)
    local_count, known, particles = tables[head + LOCAL], tables[head + ALL], tables[head + LIST]
    common, starts, count = tables[head + SHARED], tables[head + STARTS], np.int32(slabs.size)
    below, above, others = tables[head + BORDER_BEFORE], tables[head + BORDER_AFTER], np.int32(known - local_count)
    world, arrays = World(record[0], bodies, integers), (slabs.corners, slabs.values, slabs.multipliers)
    inputs = Sweep(tables, starts, colours, arrays, count, constants_of(record[0]))
    thread, threads, tag = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x), np.int32(exchange.epoch)
    place, substep = np.int64(0), np.int64(0)
    step, number = clock(counter, place, substeps, substep)
    for n in range(thread, known, threads):
        k = tables[particles + n]
        p = load_quad(state.position, k)
        store_quad(before, np.int32(n), p[0], p[1], p[2], p[3])
        if n < local_count:
            p = begin(p, load_quad(state.velocity, k), k, world, step)
        store_quad(now, np.int32(n), p[0], p[1], p[2], p[3])
    ready = ahead(np.int32(0), inputs)
    cuda.syncthreads()
    while place < steps:
        for half in range(2 * limits.iterations):  # even layers, odd ones: one loop, so that its code exists once
            fresh, late = np.int32(half < 2), half % 2 == 1
            first, last = (early, colours) if late else (np.int32(0), early)
            ready = sweep(first, last, now, before, inputs, fresh, ready)
            if late:
                send_border(messages, borders + above, now, local_count, others, tag)
                hear(messages, borders + below, now, 0, common, tag, failed)
            else:
                tag = np.int32(tag + 1)
                send_border(messages, below, now, 0, common, tag)
                if FEATURE.damped:
                    if fresh:
                        send_border(messages, 2 * borders + below, before, 0, common, tag)
                        hear(messages, 2 * borders + above, before, local_count, others, tag, failed)
                hear(messages, above, now, local_count, others, tag, failed)
            cuda.syncthreads()
        substep += 1
        if substep == substeps:
            place, substep = place + 1, np.int64(0)
        step, coming = clock(counter, place, substeps, substep)
        n = thread
        while n < local_count:  # not a range: its number of iterations would be a quotient
            p, v = end(load_quad(before, n), load_quad(now, n), world, number)
            k = tables[np.uint32(particles + n)]
            if place < steps:
                store_quad(before, n, p[0], p[1], p[2], p[3])
                p = begin(p, v, k, world, step)
                store_quad(now, n, p[0], p[1], p[2], p[3])
            else:
                store_quad(new_state.position, k, p[0], p[1], p[2], p[3])
                store_quad(new_state.velocity, k, v[0], v[1], v[2], v[3])
            n = np.int32(n + threads)
        number = coming
        cuda.syncthreads()


@cache
def make_tetrahedra_resident(real: Real, math: str, parts: frozenset[str], projection: Projection) -> Kernel:
    """Compile `tetrahedra_resident`."""
    kernel = filled(tetrahedra_resident, {"scalar": np.dtype(real) if simulated() else real})
    kernel = with_projection(with_forces(kernel, parts), math, projection)
    kernel = device_variant(real, math, particle_features(parts) | projection.features).copied(kernel)
    label = f"{projection.name}_{variant_name(real, math, parts)}"
    return make_kernel(kernel, label, launch_bounds=(MOST_THREADS, 1), **kernel_options(math))
