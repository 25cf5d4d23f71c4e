"""The kernel `resident` of tetrahedra: bodies of voxels kept on the chip, a slab a block, for all substeps of many steps.

A block holds the vertices of its slab in shared memory, projects colour by colour with a barrier of its own threads after
each, and meets its neighbours twice a sweep (slabs.py): each vertex of a common side is a message with its tag
(core/messages.py), sent as soon as it is known; no flags, and no barrier of all blocks. All blocks must run at once, which a
cooperative launch guarantees, and no wait is endless.

One message buffer a way is enough. A slab sends downwards in a sweep only after it has heard from the slab below in the
last one, which spoke after it had heard what was sent downwards then; and so upwards.

What a sweep must take is the way through one vertex: 40 tetrahedra of 8 voxels, one after the other.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.blocks import raise_flag, read_flag
from gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from gpu_backend.core.constraints import make_constants, make_run
from gpu_backend.core.device import simulated
from gpu_backend.core.forces import make_forces
from gpu_backend.core.messages import make_messages
from gpu_backend.core.quads import SIZE, load_quad, store_quad
from gpu_backend.core.world import World
from gpu_backend.mass_spring.grid.resident import PATIENCE
from gpu_backend.mass_spring.grid.strips import ALIGNMENT
from gpu_backend.tetrahedra.slabs import (
    ALL,
    BORDER_AFTER,
    BORDER_BEFORE,
    HEADER,
    LIST,
    MOST_THREADS,
    OWN,
    SHARED,
    STARTS,
)
from gpu_backend.xpbd.kernels import make_clock
from gpu_backend.xpbd.mesh_kernels import AXES
from gpu_backend.xpbd.point import make_motion
from model.core.constraints import Projection


@cache
def make_exchange(real: Any, math: str) -> SimpleNamespace:
    """What the threads of a block do together: `tell(messages, at, quads, first, count, tag)`: send vertices `first` ... of
    the slab, the messages from `at` on; `hear(messages, at, quads, first, count, tag, failed)`: wait for such messages."""
    words, inline = make_messages(real), inlined(math)
    send, receive = words.send, words.receive

    @inline
    def tell(messages, at, quads, first, count, tag):
        n, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        while n < count:  # how often a range turns would be a quotient
            q = load_quad(quads, np.int32(first + n))
            send(messages, np.int32(at + n), q[0], q[1], q[2], tag)
            n = np.int32(n + threads)

    @inline
    def hear(messages, at, quads, first, count, tag, failed):
        n, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        while n < count:
            x, y, z, here = receive(messages, np.int32(at + n), tag)
            looks = np.int32(0)
            while not here:
                looks += np.int32(1)
                if looks > PATIENCE or ((looks & 1023) == 0 and read_flag(failed, 0) != 0):
                    raise_flag(failed, 0, np.int32(1))
                    break
                x, y, z, here = receive(messages, np.int32(at + n), tag)
            vertex = np.int32(first + n)
            store_quad(quads, vertex, x, y, z, load_quad(quads, vertex)[3])
            n = np.int32(n + threads)

    return SimpleNamespace(tell=tell, hear=hear)


@cache
def make_vertices(real: Any, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """What the threads of a block do together to the `count` vertices that it owns, `particles` being where in `tables` their
    numbers are: `begin(...)`: positions that constraints start from; `end(...)`: velocities, then colliders."""
    forces, motion = make_forces(real, math, parts), make_motion(real, math, parts, AXES)
    add_gravity, add_own, predict, settle = forces.add_gravity, forces.add_own, motion.predict, motion.settle
    inline, zero = inlined(math), real(0)

    @inline
    def begin(now, before, velocity, count, tables, particles, world, step):
        parameters, k, threads = world.parameters, np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        while k < count:
            p, v = load_quad(now, k), load_quad(velocity, k)
            ax, ay, az = add_gravity(zero, zero, zero, parameters)
            ax, ay, az = add_own(ax, ay, az, tables[particles + k], p[3], parameters, world.integers, step)
            x, y, z = predict(p, v, ax, ay, az, parameters)
            store_quad(before, k, p[0], p[1], p[2], p[3])
            store_quad(now, k, x, y, z, p[3])
            k = np.int32(k + threads)

    @inline
    def end(now, before, velocity, count, world, number):
        k, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        while k < count:
            b = load_quad(before, k)
            px, py, pz, vx, vy, vz = settle(b, load_quad(now, k), world, number)
            store_quad(now, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)
            k = np.int32(k + threads)

    return SimpleNamespace(begin=begin, end=end)


@cache
def make_sweep(real: Any, math: str, projection: Projection) -> Any:
    """sweep(first, last, starts, tables, now, before, corners, values, multipliers, count, fresh, constants): a block's runs
    of the colours `first` to before `last`, whose places begin at `starts` in `tables`."""
    take, run = make_run(real, math, projection), projection.run

    @inlined(math)
    def sweep(first, last, starts, tables, now, before, corners, values, multipliers, count, fresh, constants):
        for colour in range(first, last):
            at = np.int32(starts + colour)
            start = tables[at]
            runs = np.int32((tables[at + 1] - start) // run)
            if runs > 0:
                mine, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
                while mine < runs:
                    place = np.int32(start + mine)
                    take(now, before, corners, values, multipliers, place, runs, count, fresh, constants)
                    mine = np.int32(mine + threads)
                cuda.syncthreads()

    return sweep


@cache
def make_tetrahedra_resident(real: Any, math: str, parts: frozenset[str], projection: Projection) -> Any:
    """kernel(position, velocity, new_position, new_velocity, tables, corners, values, multipliers, messages, borders, epoch,
    failed, record, bodies, integers, counter, early, colours, size, largest, steps, substeps, iterations): `steps` steps of
    the bodies of one set, from the old state to the new one.

    `tables`, `corners`, `early`, `colours`, `largest`: of Slabs, whose constraints are `size`; `messages` (3 borders *
    message_size,): downwards, upwards, downwards where vertices were, their tags `epoch` + 1, + 2, ...; `failed` (1,) int32
    is set to 1 by a block whose messages never come. Launched cooperatively, one block a slab.
    """
    of_vertices, exchange, clock = make_vertices(real, math, parts), make_exchange(real, math), make_clock(math, parts)
    begin, end, tell, hear = of_vertices.begin, of_vertices.end, exchange.tell, exchange.hear
    sweep, constants_of = make_sweep(real, math, projection), make_constants(real, math, projection)
    is_damped, scalar, zero = projection.damped, np.dtype(real) if simulated() else real, real(0)

    def tetrahedra_resident(
        position, velocity, new_position, new_velocity, tables, corners, values, multipliers, messages, borders, epoch,
        failed, record, bodies, integers, counter, early, colours, size, largest, steps, substeps, iterations,
    ):  # fmt: skip
        shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
        room = SIZE * largest
        now, before, moving = shared[:room], shared[room : 2 * room], shared[2 * room : 3 * room]
        head = np.int32(cuda.blockIdx.x * HEADER)
        own, known, particles = tables[head + OWN], tables[head + ALL], tables[head + LIST]
        common, starts, count = tables[head + SHARED], tables[head + STARTS], np.int32(size)
        below, above, others = tables[head + BORDER_BEFORE], tables[head + BORDER_AFTER], np.int32(known - own)
        world, constants = World(record[0], bodies, integers), constants_of(record[0])
        for n in range(cuda.threadIdx.x, known, cuda.blockDim.x):
            k = tables[particles + n]
            p, v = load_quad(position, k), load_quad(velocity, k)
            store_quad(now, np.int32(n), p[0], p[1], p[2], p[3])
            store_quad(before, np.int32(n), p[0], p[1], p[2], p[3])
            store_quad(moving, np.int32(n), v[0], v[1], v[2], zero)
        tag, no_colour = np.int32(epoch), np.int32(0)
        for place in range(steps):
            for substep in range(substeps):
                step, number = clock(counter, np.int64(place), np.int64(substeps), np.int64(substep))
                begin(now, before, moving, own, tables, particles, world, step)
                cuda.syncthreads()
                for half in range(2 * iterations):  # even layers, odd ones: one loop, so that its code is there once
                    fresh, late = np.int32(half < 2), half % 2 == 1
                    first, last = (early, colours) if late else (no_colour, early)
                    sweep(
                        first, last, starts, tables, now, before, corners, values, multipliers, count, fresh, constants
                    )
                    if late:
                        tell(messages, borders + above, now, own, others, tag)
                        hear(messages, borders + below, now, 0, common, tag, failed)
                    else:
                        tag = np.int32(tag + 1)
                        tell(messages, below, now, 0, common, tag)
                        if is_damped:
                            if fresh:
                                tell(messages, 2 * borders + below, before, 0, common, tag)
                                hear(messages, 2 * borders + above, before, own, others, tag, failed)
                        hear(messages, above, now, own, others, tag, failed)
                    cuda.syncthreads()
                end(now, before, moving, own, world, number)
        for n in range(cuda.threadIdx.x, own, cuda.blockDim.x):
            k = tables[particles + n]
            p, v = load_quad(now, np.int32(n)), load_quad(moving, np.int32(n))
            store_quad(new_position, k, p[0], p[1], p[2], p[3])
            store_quad(new_velocity, k, v[0], v[1], v[2], zero)

    variant = f"{projection.name}_{variant_name(real, math, parts)}"
    return make_kernel(tetrahedra_resident, variant, launch_bounds=(MOST_THREADS, 1), **kernel_options(math))
