"""Emitters and sinks on CUDA (model/fluid/plan.py, 0 and 2): launches of fixed sizes, whose threads return at once in
substeps without anything due.

`due` (one thread) counts the particles that leave each nozzle. `rank` and `totals` sum up the inactive particles, by
number, as integers, so that `emit`, one thread per number, knows which of them it becomes. `arrive` (one thread) counts
them as active. Particles in a sink get no cell in `take`, which replaces `hash_particles`, and `rest` stores how many
are left.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import AXES, load_quad, store_quad
from softlab.gpu_backend.core.scan import before, strips
from softlab.gpu_backend.fluid.sort_kernels import ACTIVE_CELLS, cell_key
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.model.base.types import Real
from softlab.model.base.variant import inlined_routine, routine
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

THREADS = 32 if simulated() else 256  # of a block that sums
BOX, SPHERE, _ = range(len(SINK_SHAPES))
# what is due at a nozzle: first layer, particles, those of its fluid due before it
D_LAYER, D_NEEDED, D_BEFORE = range(3)
DUE_FIELDS = 3


@routine
def due(counter, place, substeps, substep, record, emitters, due_now, layers):
    """Write the number of particles to emit into `due_now` (emitters + 1, DUE_FIELDS), flat, int32; D_NEEDED of the
    last row: the sum."""
    if cuda.grid(1) == 0:
        parameters, count, total = record[0], np.int32(layers.size), np.int32(0)
        _, number = clock(counter, place, substeps, substep)
        times = parameters.dt, parameters.first_step, parameters.first_time
        begin, end = instant(number, *times), instant(number + 1, *times)
        for e in range(count):
            row, at = np.int32(e * EMITTER_FIELDS), np.int32(e * DUE_FIELDS)
            since, stop, rate = emitters[row + E_SINCE], emitters[row + E_STOP], emitters[row + E_RATE]
            layers[e] = passed(end, since, stop, emitters[row + E_BEFORE], rate)
            first = np.int32(begun(passed(begin, since, stop, emitters[row + E_BEFORE], rate)))
            last = np.int32(begun(layers[e]))
            needed = np.int32(max(last - first, np.int32(0)) * np.int32(emitters[row + E_COUNT]))
            due_now[at + D_LAYER], due_now[at + D_NEEDED], due_now[at + D_BEFORE] = first, needed, np.int32(0)
            for other in range(e):
                if emitters[other * EMITTER_FIELDS + E_FLUID] == emitters[row + E_FLUID]:
                    due_now[at + D_BEFORE] += due_now[other * DUE_FIELDS + D_NEEDED]
            total = np.int32(total + needed)
        due_now[count * DUE_FIELDS + D_NEEDED] = total


@routine
def rank(there, due_now, ranks, sums):
    """Write ranks[n], the number of inactive particles of the block before n, and sums, that of the block. One
    thread per number, and one more."""
    if due_now[due_now.size - DUE_FIELDS + D_NEEDED] > 0:
        n = np.int32(cuda.grid(1))
        due = np.int32(0)
        if n < there.size and there[n] == 0:
            due = np.int32(1)
        start = before(due)
        if n < ranks.size:
            ranks[n] = start
        if cuda.threadIdx.x == THREADS - 1:
            sums[cuda.blockIdx.x] = np.int32(start + due)


@routine
def totals(due_now, sums):
    """Replace the sum of each block by the sum of all blocks before it: one block."""
    if due_now[due_now.size - DUE_FIELDS + D_NEEDED] > 0:
        strips(sums, np.int32(sums.size))


@inlined_routine
def waiting_before(n, ranks, sums):
    """Return the number of inactive particles with a lower number."""
    return np.int32(ranks[n] + sums[n // THREADS])


@inlined_routine
def coming(e, emitters, due_now, starts, ranks, sums):
    """Return the number of particles that leave nozzle e: at most the inactive ones of its fluid."""
    fluid_index = np.int32(emitters[e * EMITTER_FIELDS + E_FLUID])
    waiting = np.int32(
        waiting_before(starts[fluid_index + 1], ranks, sums) - waiting_before(starts[fluid_index], ranks, sums)
    )
    left = np.int32(waiting - due_now[e * DUE_FIELDS + D_BEFORE])
    return min(max(left, np.int32(0)), due_now[e * DUE_FIELDS + D_NEEDED])


@inlined_routine
def write(slot, n, e, item, state, emitters, points, due_now, layers):
    """Write particle n, item number `item` of the nozzle, into slot `slot` of the state."""
    position, velocity, particle = state
    row = np.int32(e * EMITTER_FIELDS)
    count = np.int32(emitters[row + E_COUNT])
    k = np.int32(due_now[e * DUE_FIELDS + D_LAYER] + item // count)
    q = np.int32(AXES * (np.int32(emitters[row + E_FIRST]) + item % count))
    distance, passed_by = emitters[row + E_DISTANCE], layers[e]
    x = emitted(points[q], emitters[row + E_X], passed_by, k, distance)
    y = emitted(points[q + 1], emitters[row + E_Y], passed_by, k, distance)
    z = emitted(points[q + 2], emitters[row + E_Z], passed_by, k, distance)
    store_quad(position, slot, x, y, z, emitters[row + E_FLUID])
    store_quad(velocity, slot, emitters[row + E_VX], emitters[row + E_VY], emitters[row + E_VZ], 0.0)
    particle[slot] = n


@routine
def emit(position, velocity, particle, there, starts, emitters, points, due_now, layers, ranks, sums):
    n, count = np.int32(cuda.grid(1)), np.int32(layers.size)
    if due_now[count * DUE_FIELDS + D_NEEDED] > 0 and n < there.size and there[n] == 0:
        slot, alive = np.int32(0), particle[there.size]
        for e in range(count):
            fluid_index = np.int32(emitters[e * EMITTER_FIELDS + E_FLUID])
            come = coming(e, emitters, due_now, starts, ranks, sums)
            if starts[fluid_index] <= n and n < starts[fluid_index + 1]:
                item = np.int32(waiting_before(n, ranks, sums) - waiting_before(starts[fluid_index], ranks, sums))
                item = np.int32(item - due_now[e * DUE_FIELDS + D_BEFORE])
                if item >= 0 and item < come:
                    there[n] = 1
                    place, state = np.int32(alive + slot + item), (position, velocity, particle)
                    write(place, n, np.int32(e), item, state, emitters, points, due_now, layers)
            slot = np.int32(slot + come)


@routine
def arrive(particle, there, starts, emitters, due_now, layers, ranks, sums, missed):
    count = np.int32(layers.size)
    if cuda.grid(1) == 0 and due_now[count * DUE_FIELDS + D_NEEDED] > 0:
        for e in range(count):
            come = coming(e, emitters, due_now, starts, ranks, sums)
            particle[there.size] += come
            missed[0] += due_now[e * DUE_FIELDS + D_NEEDED] - come


@inlined_routine
def is_in_sink(p, sinks, at):
    dx, dy, dz = p[0] - sinks[at + S_X], p[1] - sinks[at + S_Y], p[2] - sinks[at + S_Z]
    kind = np.int32(sinks[at + S_KIND])
    if kind == BOX:
        return in_box(dx, dy, dz, sinks[at + S_U], sinks[at + S_V], sinks[at + S_W])
    if kind == SPHERE:
        return in_sphere(dx, dy, dz, sinks[at + S_RADIUS])
    return behind(dx, dy, dz, sinks[at + S_U], sinks[at + S_V], sinks[at + S_W])


@routine
def take(position, number, reals, numbers, sinks, there, keys, slots, counts):
    """Compute keys as `hash_particles` of gpu_backend/fluid/sort_kernels.py; -1 for removed and inactive
    particles."""
    k = np.int32(cuda.grid(1))
    if k < keys.size:
        keys[k] = -1
        if k < number[keys.size]:
            p, ended = load_quad(position, k), False
            for s in range(sinks.size // SINK_FIELDS):
                ended = ended or is_in_sink(p, sinks, np.int32(s * SINK_FIELDS))
            if ended:
                there[number[k]] = 0
            else:
                key = np.int32(cell_key(p, reals, numbers))
                keys[k], slots[k] = key, cuda.atomic.add(counts, key, np.int32(1))


@routine
def rest(numbers, sorted_number, neighbour_counts):
    """Store the number of remaining particles where kernels read it."""
    if cuda.grid(1) == 0:
        sorted_number[sorted_number.size - 1], neighbour_counts[neighbour_counts.size - 1] = (
            numbers[ACTIVE_CELLS],
            numbers[ACTIVE_CELLS],
        )


@cache
def make_flow_kernels(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile all kernels of emitters and sinks."""
    emission, variant = (due, rank, totals, emit, arrive), fluid_variant(real, math, parts, more={"threads": THREADS})
    emits = kernels_of(variant, math, emission, f"fluid_{variant_name(real, math, parts)}")
    ends = kernels_of(device_variant(real, "exact"), "exact", (take, rest), f"fluid_{variant_name(real)}")
    return SimpleNamespace(**vars(emits), **vars(ends))
