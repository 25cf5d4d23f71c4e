"""The kernel `one-block` of the cloth: a small sheet in one block, thousands of steps per launch.

A thread has its mass in registers. Positions, and velocities if neighbours need them, are stored twice in shared
memory: a pass reads one copy and writes the other, so one barrier per pass is enough. If velocity Verlet's kicks can be
combined, its first and last pass are separate launches (mass_spring/cloth/kernels.py), which leaves a loop with one
force evaluation.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import air_now
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.moves import moves_of
from softlab.gpu_backend.mass_spring.cloth.point import cloth_features, current_step, of_scene
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, routine
from softlab.model.mass_spring.cloth_plan import kicks_coupled

MAX_THREADS = 1024  # per block, hence masses
move = Open("move(position, velocity, place, k, cell, p, v, world, step, air): of moves.moves_of")
first_phase = Open("first_phase: `phase` of a step's only or first pass")
second_phase = Open("second_phase: `phase` of a step's second pass, where it has two")
scalar = Open("scalar: type of a number, in the form for shared arrays")


def block_threads(masses: int) -> int:
    """Return the threads of the block: a power of two, so that few variants are compiled."""
    return max(32, 1 << (masses - 1).bit_length())


def block_bytes(real: Real, parts: frozenset[str], masses: int) -> int:
    """Return the shared memory of the block [bytes]: two copies of the values that neighbours read, and of the air's
    velocity."""
    arrays = 2 if kicks_coupled(parts) else 4
    return (arrays * masses + 2) * SIZE * np.dtype(real).itemsize


@inlined_routine
def phase(copies, old, new, inside, k, cell, state, world, step, air):
    """Do one pass of the thread's mass, from the copies (positions, velocities) that begin at `old` to those at `new`.
    Returns its state (position, velocity)."""
    (positions, velocities), (p, v) = copies, state
    if inside:
        px, py, pz, vx, vy, vz = move(positions, velocities, np.int32(old + k), k, cell, p, v, world, step, air)
        p, v = (px, py, pz, p[3]), (vx, vy, vz, 0.0)
        store_quad(positions, new + k, px, py, pz, p[3])
        if FEATURE.neighbour_velocities:
            store_quad(velocities, new + k, vx, vy, vz, 0.0)
    cuda.syncthreads()
    return p, v


@inlined_routine
def read_air(airs, place):
    x, y, z, _ = load_quad(airs, place)
    return x, y, z


@routine
def block_steps(
    position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number, passes, rows,
    columns,
):  # fmt: skip
    parameters = record[0]
    world = World(parameters, bodies, integers)
    shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
    rows, columns = np.int32(rows), np.int32(columns)
    masses = np.int32(rows * columns)
    k = np.int32(cuda.threadIdx.x)
    i, j = np.int32(k // columns), np.int32(k % columns)
    inside = k < masses
    velocities = shared[2 * SIZE * masses :] if FEATURE.neighbour_velocities else shared[0:]
    airs = shared[4 * SIZE * masses :] if FEATURE.neighbour_velocities else shared[2 * SIZE * masses :]
    first = current_step(counter, pass_number)
    copies, cell = (shared, velocities), Cell(i, j, rows, columns)
    p, v = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
    if inside:
        p, v = load_quad(position, k), load_quad(velocity, k)
        store_quad(shared, k, p[0], p[1], p[2], p[3])
        if FEATURE.neighbour_velocities:
            store_quad(velocities, k, v[0], v[1], v[2], 0.0)
    air = (0.0, 0.0, 0.0)
    if FEATURE.gust:
        if k == 0:
            x, y, z = air_now(parameters, integers, first, 0.0)
            store_quad(airs, 0, x, y, z, 0.0)
    elif FEATURE.wind:
        air = air_now(parameters, integers, first, 0.0)
    cuda.syncthreads()
    old = np.int32(0)
    for number in range(passes):
        step = first + number
        new, now = np.int32(masses - old), np.int32(number & 1)
        if FEATURE.gust:  # the first thread computes the next step's air besides its mass
            air = read_air(airs, now)
            if k == 0:
                x, y, z = air_now(parameters, integers, step + 1, 0.0)
                store_quad(airs, 1 - now, x, y, z, 0.0)
        p, v = first_phase(copies, old, new, inside, k, cell, (p, v), world, step, air)
        if FEATURE.neighbour_velocities and FEATURE.verlet:
            if FEATURE.gust:
                air = read_air(airs, 1 - now)
            p, v = second_phase(copies, new, old, inside, k, cell, (p, v), world, step + 1, air)
        else:
            old = new
    if inside:
        store_quad(new_position, k, p[0], p[1], p[2], p[3])
        store_quad(new_velocity, k, v[0], v[1], v[2], 0.0)


@cache
def make_cloth_block(real: Real, math: str, integrator: str, parts: frozenset[str], threads: int) -> Kernel:
    """Compile kernel(position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number,
    passes, rows, columns): `passes` steps of the whole sheet, from the old state to the new one.

    If velocity Verlet's kicks can be combined, `passes` of its middle passes. Launched with one block of `threads`
    threads, a mass each, and `block_bytes` of shared memory.
    """
    moves, moving = moves_of(integrator), not kicks_coupled(parts)
    pairs = moving and "middle" in moves  # a step is two passes
    first = moves["opening" if pairs else "middle" if "middle" in moves else "step"]
    names = {
        "first_phase": filled(phase, {"move": first}),
        "second_phase": filled(phase, {"move": moves.get("closing", first)}),
        "scalar": np.dtype(real) if simulated() else real,
    }
    variant = device_variant(real, math, {**cloth_features(integrator, parts), "neighbour_velocities": moving})
    kernel = variant.copied(of_scene(filled(block_steps, names), integrator, parts))
    label = variant_name(real, math, integrator, parts, threads)
    return make_kernel(kernel, label, launch_bounds=(threads, 1), **kernel_options(math))
