"""CUDA kernels of the cloth: one thread per mass, one pass over the sheet per launch, as in
mass_spring/grid/kernels.py.

Position and velocity are quads (core/quads.py); the fourth number of a position marks pinned masses (contact/pins.py).
With gusts, the air's velocity, which is the same for all masses, is computed by one thread of each block.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.moves import RK4_OFFSETS, make_cloth_moves, make_cloth_rk4
from softlab.gpu_backend.mass_spring.cloth.point import make_cloth_forces
from softlab.model.formulas import cloth


@cache
def make_block_air(real: Any, math: str, parts: frozenset[str]) -> Any:
    """Make air(parameters, integers, step, offset) -> (x, y, z) [m/s]; every thread of the block must call it."""
    air_now = make_cloth_forces(real, math, parts).air_now
    has_wind, has_gust = "wind" in parts, "gust" in parts
    zero = real(0)

    @inlined(math)
    def block_air(parameters, integers, step, offset):
        if has_gust:
            shared = cuda.shared.array(3, real)
            if cuda.threadIdx.x == 0 and cuda.threadIdx.y == 0:
                shared[0], shared[1], shared[2] = air_now(parameters, integers, step, offset)
            cuda.syncthreads()
            return shared[0], shared[1], shared[2]
        if has_wind:
            return air_now(parameters, integers, step, offset)
        return zero, zero, zero

    return block_air


@cache
def make_cloth_passes(real: Any, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Any]:
    """Compile the kernels of one-force integrators (`step`) or of velocity Verlet (`opening`, `middle`, `closing`).

    Each is kernel(position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number, rows,
    columns): flat arrays of quads, the constants, the colliders' rows one after the other, the integer record
    (mass_spring/cloth/point.py), the step counter and the pass's number after it.
    """
    current_step, block_air = make_cloth_forces(real, math, parts).current_step, make_block_air(real, math, parts)
    zero = real(0)

    def make_pass(name: str, move: Any) -> Any:
        def cloth_pass(
            position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number, rows,
            columns,
        ):  # fmt: skip
            parameters = record[0]
            world = World(parameters, bodies, integers)
            j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
            i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
            rows = np.int32(rows)
            columns = np.int32(columns)
            step = current_step(counter, pass_number)
            air = block_air(parameters, integers, step, zero)
            if i < rows and j < columns:
                k = np.int32(i * columns + j)
                p, v = load_quad(position, k), load_quad(velocity, k)
                px, py, pz, vx, vy, vz = move(
                    position, velocity, k, k, Cell(i, j, rows, columns), p, v, world, step, air
                )
                store_quad(new_position, k, px, py, pz, p[3])
                store_quad(new_velocity, k, vx, vy, vz, zero)

        return make_kernel(cloth_pass, variant_name(real, math, integrator, parts, name), **kernel_options(math))

    moves = make_cloth_moves(real, math, integrator, parts)
    return {name: make_pass(name, move) for name, move in moves.items()}


@cache
def make_cloth_rk4_stages(real: Any, math: str, parts: frozenset[str]) -> list[Any]:
    """Compile the four stage kernels of RK4.

    kernel(position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
    record, bodies, integers, counter, pass_number, rows, columns): neighbours are read in (position, velocity), the
    state of the stage; each stage adds to the total, the last one writes the new state to `new`.
    """
    current_step, block_air = make_cloth_forces(real, math, parts).current_step, make_block_air(real, math, parts)
    zero = real(0)

    def make_stage(stage: int) -> Any:
        move = make_cloth_rk4(real, math, parts, stage)
        offset = real(RK4_OFFSETS[stage])
        first, last = stage == 0, stage == 3

        def cloth_rk4(
            position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
            record, bodies, integers, counter, pass_number, rows, columns,
        ):  # fmt: skip
            parameters = record[0]
            world = World(parameters, bodies, integers)
            j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
            i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
            rows = np.int32(rows)
            columns = np.int32(columns)
            step = current_step(counter, pass_number)
            air = block_air(parameters, integers, step, offset)
            if i < rows and j < columns:
                k = np.int32(i * columns + j)
                p, v = load_quad(position, k), load_quad(velocity, k)
                base_p, base_v = load_quad(base_position, k), load_quad(base_velocity, k)
                if first:
                    total_p, total_v = base_p, base_v
                else:
                    total_p, total_v = load_quad(total_position, k), load_quad(total_velocity, k)
                new_p, new_v, sum_p, sum_v = move(
                    position, velocity, k, k, Cell(i, j, rows, columns), p, v, base_p, base_v, total_p, total_v, world, step,
                    air,
                )  # fmt: skip
                if not last:
                    store_quad(total_position, k, sum_p[0], sum_p[1], sum_p[2], zero)
                    store_quad(total_velocity, k, sum_v[0], sum_v[1], sum_v[2], zero)
                store_quad(new_position, k, new_p[0], new_p[1], new_p[2], p[3])
                store_quad(new_velocity, k, new_v[0], new_v[1], new_v[2], zero)

        return make_kernel(cloth_rk4, variant_name(real, math, parts, stage), **kernel_options(math))

    return [make_stage(stage) for stage in range(4)]


@cache
def make_cloth_tools(real: Any) -> SimpleNamespace:
    """Compile small kernels around the passes: count steps, find bad masses, write positions and normals for
    drawing."""
    formulas = device_formulas(cloth.make, real, "exact")
    cross, unit = formulas.cross, formulas.unit
    inline = inlined("exact")
    one = np.int32(1)

    def count(counter, steps):
        if cuda.grid(1) == 0:
            counter[0] += steps

    def first_diverged(position, velocity, bound, x, y, z, result):
        """Find the lowest index of a mass that is not finite, or farther than `bound` from (x, y, z) along an axis, by
        an atomic minimum of integers."""
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v = load_quad(position, k), load_quad(velocity, k)
            inside = abs(p[0] - x) <= bound and abs(p[1] - y) <= bound and abs(p[2] - z) <= bound  # false for NaN
            still = v[0] - v[0] == v[1] - v[1] and v[1] - v[1] == v[2] - v[2]  # false for NaN and infinity
            if not (inside and still):
                cuda.atomic.min(result, 0, k)

    def write_position(position, out):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p = load_quad(position, k)
            out[k, 0] = p[0]
            out[k, 1] = p[1]
            out[k, 2] = p[2]

    @inline
    def triangle(position, a, b, c):
        """Return the normal of the triangle of masses a, b, c, with the length of twice its area."""
        p, q, r = load_quad(position, a), load_quad(position, b), load_quad(position, c)
        return cross(q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2])

    @inline
    def cell_sum(position, k, cell):
        """Return the sum of the normals of the up to six triangles at mass k, as in mass_spring/cloth/point.py."""
        i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
        top, bottom, first, last = i == 0, i == rows - 1, j == 0, j == columns - 1
        right, below = k if last else k + one, k if bottom else k + columns
        left, above = k if first else k - one, k if top else k - columns
        below_right = k if bottom or last else k + columns + one
        above_left = k if top or first else k - columns - one
        a = triangle(position, k, below, below_right)
        b = triangle(position, k, below_right, right)
        c = triangle(position, k if bottom else left, below, k)
        d = triangle(position, k if last else above, k, right)
        e = triangle(position, above_left, left, k)
        f = triangle(position, above_left, k, above)
        return (
            (a[0] + b[0]) + (c[0] + d[0]) + (e[0] + f[0]),
            (a[1] + b[1]) + (c[1] + d[1]) + (e[1] + f[1]),
            (a[2] + b[2]) + (c[2] + d[2]) + (e[2] + f[2]),
        )

    def write_normal(position, out, rows, columns):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            rows, columns = np.int32(rows), np.int32(columns)
            cell = Cell(np.int32(k // columns), np.int32(k % columns), rows, columns)
            x, y, z = cell_sum(position, k, cell)
            out[k, 0], out[k, 1], out[k, 2] = unit(x, y, z)

    tools = (count, first_diverged, write_position, write_normal)
    return make_kernels(tools, f"cloth_{variant_name(real)}")
