"""The kernel `one-block` of the cloth: a small sheet in one block, thousands of steps per launch.

A thread has its mass in registers. Positions, and velocities if neighbours need them, are stored twice in shared
memory: a pass reads one copy and writes the other, so one barrier per pass is enough. If velocity Verlet's kicks can be
combined, its first and last pass are separate launches (mass_spring/cloth/kernels.py), which leaves a loop with one
force evaluation.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.moves import make_cloth_moves
from softlab.gpu_backend.mass_spring.cloth.point import make_cloth_forces
from softlab.model.mass_spring.cloth_plan import kicks_coupled

MAX_THREADS = 1024  # per block, hence masses


def block_threads(masses: int) -> int:
    """Return the threads of the block: a power of two, so that few variants are compiled."""
    return max(32, 1 << (masses - 1).bit_length())


def block_bytes(real: Any, parts: frozenset[str], masses: int) -> int:
    """Return the shared memory of the block [bytes]: two copies of what neighbours read, and of the air's velocity."""
    arrays = 2 if kicks_coupled(parts) else 4
    return (arrays * masses + 2) * SIZE * np.dtype(real).itemsize


def _make_phase(real: Any, math: str, moving: bool, move: Any) -> Any:
    """Make one pass of the thread's mass, from the copies that begin at `old` to those at `new`."""
    zero = real(0)

    @inlined(math)
    def phase(positions, velocities, old, new, inside, k, cell, p, v, world, step, air):
        if inside:
            px, py, pz, vx, vy, vz = move(
                positions, velocities, np.int32(old + k), k, cell, p, v, world,
                step, air,
            )  # fmt: skip
            p, v = (px, py, pz, p[3]), (vx, vy, vz, zero)
            store_quad(positions, new + k, px, py, pz, p[3])
            if moving:
                store_quad(velocities, new + k, vx, vy, vz, zero)
        cuda.syncthreads()
        return p, v

    return phase


@cache
def make_cloth_block(real: Any, math: str, integrator: str, parts: frozenset[str], threads: int) -> Any:
    """Compile kernel(position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number,
    passes, rows, columns): `passes` steps of the whole sheet, from the old state to the new one.

    If velocity Verlet's kicks can be combined, `passes` of its middle passes. Launched with one block of `threads`
    threads, a mass each, and `block_bytes` of shared memory.
    """
    forces = make_cloth_forces(real, math, parts)
    current_step, air_now = forces.current_step, forces.air_now
    moves = make_cloth_moves(real, math, integrator, parts)
    moving, has_wind, has_gust = not kicks_coupled(parts), "wind" in parts, "gust" in parts
    pairs = moving and "middle" in moves  # a step is two passes
    first_move = moves["opening"] if pairs else moves["middle"] if "middle" in moves else moves["step"]
    scalar = np.dtype(real) if simulated() else real
    arrays = 4 if moving else 2
    zero = real(0)
    first_phase = _make_phase(real, math, moving, first_move)
    second_phase = _make_phase(real, math, moving, moves.get("closing", first_move))

    @inlined(math)
    def read_air(airs, place):
        x, y, z, _ = load_quad(airs, place)
        return x, y, z

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
        velocities = shared[2 * SIZE * masses if moving else 0 :]
        airs = shared[arrays * SIZE * masses :]
        first = current_step(counter, pass_number)
        p, v = (zero, zero, zero, zero), (zero, zero, zero, zero)
        if inside:
            p, v = load_quad(position, k), load_quad(velocity, k)
            store_quad(shared, k, p[0], p[1], p[2], p[3])
            if moving:
                store_quad(velocities, k, v[0], v[1], v[2], zero)
        air = (zero, zero, zero)
        if has_gust:
            if k == 0:
                x, y, z = air_now(parameters, integers, first, zero)
                store_quad(airs, 0, x, y, z, zero)
        elif has_wind:
            air = air_now(parameters, integers, first, zero)
        cuda.syncthreads()
        old = np.int32(0)
        for number in range(passes):
            step = first + number
            new, now = np.int32(masses - old), np.int32(number & 1)
            if has_gust:  # the first thread computes the next step's air besides its mass
                air = read_air(airs, now)
                if k == 0:
                    x, y, z = air_now(parameters, integers, step + 1, zero)
                    store_quad(airs, 1 - now, x, y, z, zero)
            p, v = first_phase(
                shared,
                velocities,
                old,
                new,
                inside,
                k,
                Cell(i, j, rows, columns),
                p,
                v,
                world,
                step,
                air,
            )
            if pairs:
                if has_gust:
                    air = read_air(airs, 1 - now)
                p, v = second_phase(
                    shared, velocities, new, old, inside, k, Cell(i, j, rows, columns), p, v, world,
                    step + 1, air,
                )  # fmt: skip
            else:
                old = new
        if inside:
            store_quad(new_position, k, p[0], p[1], p[2], p[3])
            store_quad(new_velocity, k, v[0], v[1], v[2], zero)

    variant = variant_name(real, math, integrator, parts, threads)
    return make_kernel(block_steps, variant, launch_bounds=(threads, 1), **kernel_options(math))
