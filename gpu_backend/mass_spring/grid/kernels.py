"""CUDA kernels of the mass-spring grid: one thread per mass, one pass over the grid per launch.

A mass is one thread of a two-dimensional block, 32 columns wide so that a warp reads 32 neighbouring masses of a row in
one transaction, 8 rows high so that most vertical neighbours are read by the same block (and found in its cache).
Position and velocity are complex numbers: one 8-byte load (16 in float64, core/pairs.py) reads both axes, and indices
are 32-bit.

Each thread reads its four neighbours from the old state and writes its own mass in the new one, so no two threads write
to one address and none reads what another writes in the same launch: no locks, no atomics. The order between passes is
the order of launches in the stream. mass_spring/grid/point.py has the computation of a thread.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.pairs import load_pair, store_pair
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.mass_spring.grid.point import (
    acceleration,
    current_step,
    grid_features,
    moves_of,
    of_scene,
    spring_sum,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine
from softlab.model.formulas.integrators import rk4_stage

move = Open("move(k, ax, ay, p, v, parameters, integers, step): of point.moves_of")


@routine
def grid_pass(
    position, velocity, new_position, new_velocity, record, integers, counter, pass_number, pinned_row, pinned,
    rows, columns,
):  # fmt: skip
    parameters = record[0]
    j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
    i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
    rows = np.int32(rows)
    columns = np.int32(columns)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        step = current_step(counter, pass_number)
        p, v = load_pair(position, k), load_pair(velocity, k)
        ax, ay = spring_sum(position, k, Cell(i, j, rows, columns), parameters)
        px, py, vx, vy = move(k, ax, ay, p, v, parameters, integers, step)
        if FEATURE.pins:
            if pinned_row[i] != 0:
                if pinned[k] != 0:
                    px, py, vx, vy = p.real, p.imag, 0.0, 0.0
        store_pair(new_position, k, px, py)
        store_pair(new_velocity, k, vx, vy)


@routine
def rk4_pass(
    position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
    record, integers, counter, pass_number, pinned_row, pinned, rows, columns,
):  # fmt: skip
    parameters = record[0]
    j = np.int32(cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x)
    i = np.int32(cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y)
    rows = np.int32(rows)
    columns = np.int32(columns)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        p, v = load_pair(position, k), load_pair(velocity, k)
        step = current_step(counter, pass_number)
        ax, ay = spring_sum(position, k, Cell(i, j, rows, columns), parameters)
        ax, ay = acceleration(ax, ay, v, k, parameters, integers, step)
        base_p, base_v = load_pair(base_position, k), load_pair(base_velocity, k)
        if FEATURE.stage == 0:
            total_p, total_v = base_p, base_v
        else:
            total_p, total_v = load_pair(total_position, k), load_pair(total_velocity, k)
        derivative_dt = parameters.half_dt if FEATURE.stage < 2 else parameters.dt
        total_dt = parameters.sixth_dt if FEATURE.stage == 0 or FEATURE.stage == 3 else parameters.third_dt
        px, sum_px = rk4_stage(base_p.real, v.real, total_p.real, derivative_dt, total_dt)
        py, sum_py = rk4_stage(base_p.imag, v.imag, total_p.imag, derivative_dt, total_dt)
        vx, sum_vx = rk4_stage(base_v.real, ax, total_v.real, derivative_dt, total_dt)
        vy, sum_vy = rk4_stage(base_v.imag, ay, total_v.imag, derivative_dt, total_dt)
        if FEATURE.stage == 3:
            px, py, vx, vy = sum_px, sum_py, sum_vx, sum_vy
        else:
            store_pair(total_position, k, sum_px, sum_py)
            store_pair(total_velocity, k, sum_vx, sum_vy)
        if FEATURE.pins:
            if pinned_row[i] != 0:
                if pinned[k] != 0:
                    px, py, vx, vy = p.real, p.imag, 0.0, 0.0
        store_pair(new_position, k, px, py)
        store_pair(new_velocity, k, vx, vy)


@routine
def count(counter, steps):
    if cuda.grid(1) == 0:
        counter[0] += steps


@routine
def first_diverged(position, velocity, bound, x, y, _, result):
    """Find the lowest index of a mass that is not finite, or farther than `bound` from (x, y) along an axis, by an
    atomic minimum of integers."""
    k = cuda.grid(1)
    if k < position.shape[0]:
        p, v = load_pair(position, k), load_pair(velocity, k)
        inside = abs(p.real - x) <= bound and abs(p.imag - y) <= bound  # false for NaN
        still = v.real - v.real == v.imag - v.imag  # false for NaN and infinity
        if not (inside and still):
            cuda.atomic.min(result, 0, k)


@routine
def write_position(position, out):
    k = cuda.grid(1)
    if k < position.shape[0]:
        p = position[k]
        out[k, 0] = p.real
        out[k, 1] = p.imag


@cache
def make_passes(real: Real, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Kernel]:
    """Compile the kernels of one-force integrators (`step`) or of velocity Verlet (`opening`, `middle`, `closing`).

    Each is kernel(position, velocity, new_position, new_velocity, record, integers, counter, pass_number, pinned_row,
    pinned, rows, columns): complex (particles,) arrays, the constants, the step counter and the pass's number after it,
    which rows have pins and which masses are pinned.
    """
    variant = device_variant(real, math, grid_features(integrator, parts))

    def compiled(name: str) -> Kernel:
        kernel, label = filled(grid_pass, {"move": moves[name]}), variant_name(real, math, integrator, parts, name)
        return kernels_of(variant, math, (kernel,), label).grid_pass

    moves = moves_of(integrator, parts)
    return {name: compiled(name) for name in moves}


@cache
def make_rk4_stages(real: Real, math: str, parts: frozenset[str]) -> list[Kernel]:
    """Compile the four stage kernels of RK4.

    kernel(position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
    record, integers, counter, pass_number, pinned_row, pinned, rows, columns): neighbours are read in (position,
    velocity), the state of the stage; each stage adds to the total, the last one writes the new state to `new`.
    """
    kernel = of_scene(rk4_pass, "rk4", parts)

    def compiled(stage: int) -> Kernel:
        variant = device_variant(real, math, {**grid_features("rk4", parts), "stage": stage})
        return kernels_of(variant, math, (kernel,), variant_name(real, math, parts, stage)).rk4_pass

    return [compiled(stage) for stage in range(4)]


@cache
def make_tools(real: Real) -> SimpleNamespace:
    """Compile small kernels around the passes: count steps, find bad masses, write positions for drawing."""
    return kernels_of(
        device_variant(real, "exact"), "exact", (count, first_diverged, write_position), variant_name(real)
    )
