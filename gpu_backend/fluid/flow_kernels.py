"""Emitters and sinks on CUDA (model/fluid/plan.py, 0 and 2): launches of fixed sizes, whose threads return at once in
substeps without anything due.

`due` (one thread) counts what leaves each nozzle. `rank` and `totals` sum up the inactive particles, by number, as
integers, so that `emit`, one thread per number, knows which of them it becomes. `arrive` (one thread) counts them as
active. Particles in a sink get no cell in `take`, which replaces `hash_particles`, and `rest` stores how many are left.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.device import simulated
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.scan import make_before, make_strips
from softlab.gpu_backend.fluid.sort_kernels import ACTIVE_CELLS, DEPTH, HEIGHT, INVERSE, LOW, WIDTH
from softlab.model.base.types import Real
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
from softlab.model.formulas import cloth
from softlab.model.formulas.fluid import cells as grid
from softlab.model.formulas.fluid import flow

THREADS = 32 if simulated() else 256  # of a block that sums
BOX, SPHERE, _ = range(len(SINK_SHAPES))
# what is due at a nozzle: first layer, particles, those of its fluid due before it
D_LAYER, D_NEEDED, D_BEFORE = range(3)
DUE_FIELDS = 3


def _make_due(real: Real, math: str, parts: frozenset[str]) -> tuple[Callable, ...]:
    """Make `due`, `rank`, `totals` (see the module docstring).

    `due_now` (emitters + 1, DUE_FIELDS), flat, int32: what is due; D_NEEDED of the last row: the sum.
    """
    f, clock = device_formulas(flow, real, math), make_clock(math, parts)
    instant, passed, begun = device_formulas(cloth, real, math).instant, f.passed, f.begun
    before, strips, threads, next_one = make_before(THREADS), make_strips(THREADS), np.int32(THREADS), np.int64(1)
    one, zero, fields, row_size = np.int32(1), np.int32(0), np.int32(DUE_FIELDS), np.int32(EMITTER_FIELDS)

    def due(counter, place, substeps, substep, record, emitters, due_now, layers):
        if cuda.grid(1) == 0:
            parameters, count, total = record[0], np.int32(layers.size), zero
            _, number = clock(counter, place, substeps, substep)
            times = parameters.dt, parameters.first_step, parameters.first_time
            begin, end = instant(number, *times), instant(number + next_one, *times)
            for e in range(count):
                row, at = np.int32(e * row_size), np.int32(e * fields)
                since, stop, rate = emitters[row + E_SINCE], emitters[row + E_STOP], emitters[row + E_RATE]
                layers[e] = passed(end, since, stop, emitters[row + E_BEFORE], rate)
                first = np.int32(begun(passed(begin, since, stop, emitters[row + E_BEFORE], rate)))
                last = np.int32(begun(layers[e]))
                needed = np.int32(max(last - first, zero) * np.int32(emitters[row + E_COUNT]))
                due_now[at + D_LAYER], due_now[at + D_NEEDED], due_now[at + D_BEFORE] = first, needed, zero
                for other in range(e):
                    if emitters[other * row_size + E_FLUID] == emitters[row + E_FLUID]:
                        due_now[at + D_BEFORE] += due_now[other * fields + D_NEEDED]
                total = np.int32(total + needed)
            due_now[count * fields + D_NEEDED] = total

    def rank(there, due_now, ranks, sums):
        """Write ranks[n], the number of inactive particles of the block before n, and sums, that of the block. One
        thread per number, and one more."""
        if due_now[due_now.size - fields + D_NEEDED] > zero:
            n = np.int32(cuda.grid(1))
            due = zero
            if n < there.size and there[n] == zero:
                due = one
            start = before(due)
            if n < ranks.size:
                ranks[n] = start
            if cuda.threadIdx.x == threads - one:
                sums[cuda.blockIdx.x] = np.int32(start + due)

    def totals(due_now, sums):
        """Replace the sum of each block by the sum of all blocks before it: one block."""
        if due_now[due_now.size - fields + D_NEEDED] > zero:
            strips(sums, np.int32(sums.size))

    return due, rank, totals


def _make_emission(real: Real, math: str) -> tuple[Callable, ...]:
    """Make `emit` and `arrive`."""
    emitted, threads, axes = device_formulas(flow, real, math).emitted, np.int32(THREADS), np.int32(3)
    one, zero, fields, row_size = np.int32(1), np.int32(0), np.int32(DUE_FIELDS), np.int32(EMITTER_FIELDS)

    @inlined("exact")
    def waiting_before(n, ranks, sums):
        """Return the number of inactive particles with a lower number."""
        return np.int32(ranks[n] + sums[n // threads])

    @inlined("exact")
    def coming(e, emitters, due_now, starts, ranks, sums):
        """Return the number of particles that leave nozzle e: at most the inactive ones of its fluid."""
        fluid_index = np.int32(emitters[e * row_size + E_FLUID])
        waiting = np.int32(
            waiting_before(starts[fluid_index + one], ranks, sums) - waiting_before(starts[fluid_index], ranks, sums)
        )
        left = np.int32(waiting - due_now[e * fields + D_BEFORE])
        return min(max(left, zero), due_now[e * fields + D_NEEDED])

    @inlined("exact")
    def write(slot, n, e, item, position, velocity, particle, emitters, points, due_now, layers):
        """Write particle n, item number `item` of the nozzle, into slot `slot` of the state."""
        row = np.int32(e * row_size)
        count = np.int32(emitters[row + E_COUNT])
        k = np.int32(due_now[e * fields + D_LAYER] + item // count)
        q = np.int32(axes * (np.int32(emitters[row + E_FIRST]) + item % count))
        distance, passed_by = emitters[row + E_DISTANCE], layers[e]
        x = emitted(points[q], emitters[row + E_X], passed_by, k, distance)
        y = emitted(points[q + 1], emitters[row + E_Y], passed_by, k, distance)
        z = emitted(points[q + 2], emitters[row + E_Z], passed_by, k, distance)
        store_quad(position, slot, x, y, z, emitters[row + E_FLUID])
        store_quad(velocity, slot, emitters[row + E_VX], emitters[row + E_VY], emitters[row + E_VZ], real(0))
        particle[slot] = n

    def emit(position, velocity, particle, there, starts, emitters, points, due_now, layers, ranks, sums):
        n, count = np.int32(cuda.grid(1)), np.int32(layers.size)
        if due_now[count * fields + D_NEEDED] > zero and n < there.size and there[n] == zero:
            slot, alive = zero, particle[there.size]
            for e in range(count):
                fluid_index, come = (
                    np.int32(emitters[e * row_size + E_FLUID]),
                    coming(e, emitters, due_now, starts, ranks, sums),
                )
                if starts[fluid_index] <= n and n < starts[fluid_index + one]:
                    item = np.int32(waiting_before(n, ranks, sums) - waiting_before(starts[fluid_index], ranks, sums))
                    item = np.int32(item - due_now[e * fields + D_BEFORE])
                    if zero <= item and item < come:
                        there[n] = one
                        place = np.int32(alive + slot + item)
                        write(
                            place, n, np.int32(e), item, position, velocity, particle, emitters, points, due_now, layers
                        )
                slot = np.int32(slot + come)

    def arrive(particle, there, starts, emitters, due_now, layers, ranks, sums, missed):
        count = np.int32(layers.size)
        if cuda.grid(1) == 0 and due_now[count * fields + D_NEEDED] > zero:
            for e in range(count):
                come = coming(e, emitters, due_now, starts, ranks, sums)
                particle[there.size] += come
                missed[0] += due_now[e * fields + D_NEEDED] - come

    return emit, arrive


def _make_sinks(real: Real) -> tuple[Callable, ...]:
    cell_of, f = device_formulas(grid, real, "exact").cell_of, device_formulas(flow, real, "exact")
    in_box, in_sphere, behind, one = f.in_box, f.in_sphere, f.behind, np.int32(1)
    size, gone, zero = np.int32(SINK_FIELDS), np.int32(-1), np.int32(0)

    @inlined("exact")
    def ends(p, sinks, at):
        dx, dy, dz = p[0] - sinks[at + S_X], p[1] - sinks[at + S_Y], p[2] - sinks[at + S_Z]
        kind = np.int32(sinks[at + S_KIND])
        if kind == BOX:
            return in_box(dx, dy, dz, sinks[at + S_U], sinks[at + S_V], sinks[at + S_W])
        if kind == SPHERE:
            return in_sphere(dx, dy, dz, sinks[at + S_RADIUS])
        return behind(dx, dy, dz, sinks[at + S_U], sinks[at + S_V], sinks[at + S_W])

    def take(position, number, reals, numbers, sinks, there, keys, slots, counts):
        """Compute keys as `hash_particles` of gpu_backend/fluid/sort_kernels.py; -1 for removed and inactive
        particles."""
        k = np.int32(cuda.grid(1))
        if k < keys.size:
            keys[k] = gone
            if k < number[keys.size]:
                p, ended = load_quad(position, k), False
                for s in range(sinks.size // size):
                    ended = ended or ends(p, sinks, np.int32(s * size))
                if ended:
                    there[number[k]] = zero
                else:
                    x = cell_of(p[0], reals[LOW], reals[INVERSE], numbers[WIDTH])
                    y = cell_of(p[1], reals[LOW + 1], reals[INVERSE + 1], numbers[HEIGHT])
                    z = cell_of(p[2], reals[LOW + 2], reals[INVERSE + 2], numbers[DEPTH])
                    key = np.int32((z * numbers[HEIGHT] + y) * numbers[WIDTH] + x)
                    keys[k], slots[k] = key, cuda.atomic.add(counts, key, one)

    def rest(numbers, sorted_number, neighbour_counts):
        """Store the number of remaining particles where kernels read it."""
        if cuda.grid(1) == 0:
            sorted_number[sorted_number.size - 1], neighbour_counts[neighbour_counts.size - 1] = (
                numbers[ACTIVE_CELLS],
                numbers[ACTIVE_CELLS],
            )

    return take, rest


@cache
def make_flow_kernels(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile all kernels of emitters and sinks."""
    emission = make_kernels(
        (*_make_due(real, math, parts), *_make_emission(real, math)),
        f"fluid_{variant_name(real, math, parts)}",
        **kernel_options(math),
    )
    sinks = make_kernels(_make_sinks(real), f"fluid_{variant_name(real)}", **kernel_options("exact"))
    return SimpleNamespace(**vars(emission), **vars(sinks))
