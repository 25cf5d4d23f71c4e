"""CUDA kernels of the cloth: one thread per mass, one pass over the sheet per launch, as in
mass_spring/grid/kernels.py.

Position and velocity are quads (core/quads.py); the fourth number of a position marks pinned masses (contact/pins.py).
With gusts, the air's velocity, which is the same for all masses, is computed by one thread of each block.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.wind import block_air
from softlab.gpu_backend.core.world import Cell, World
from softlab.gpu_backend.mass_spring.cloth.moves import RK4_OFFSETS, moves_of, rk4_mass
from softlab.gpu_backend.mass_spring.cloth.point import cloth_features, current_step, of_scene
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine

move = Open("move(position, velocity, place, k, cell, p, v, world, step, air): of moves.moves_of")
stage_offset = Open("stage_offset: of RK4_OFFSETS, in the precision of the variant")


@routine
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
    air = block_air(parameters, integers, step, 0.0)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        p, v = load_quad(position, k), load_quad(velocity, k)
        px, py, pz, vx, vy, vz = move(position, velocity, k, k, Cell(i, j, rows, columns), p, v, world, step, air)
        store_quad(new_position, k, px, py, pz, p[3])
        store_quad(new_velocity, k, vx, vy, vz, 0.0)


@routine
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
    air = block_air(parameters, integers, step, stage_offset)
    if i < rows and j < columns:
        k = np.int32(i * columns + j)
        p, v = load_quad(position, k), load_quad(velocity, k)
        base = load_quad(base_position, k), load_quad(base_velocity, k)
        if FEATURE.stage == 0:
            total = base
        else:
            total = load_quad(total_position, k), load_quad(total_velocity, k)
        new_p, new_v, sum_p, sum_v = rk4_mass(
            position, velocity, k, Cell(i, j, rows, columns), (p, v), base, total, world, step, air
        )
        if FEATURE.stage < 3:
            store_quad(total_position, k, sum_p[0], sum_p[1], sum_p[2], 0.0)
            store_quad(total_velocity, k, sum_v[0], sum_v[1], sum_v[2], 0.0)
        store_quad(new_position, k, new_p[0], new_p[1], new_p[2], p[3])
        store_quad(new_velocity, k, new_v[0], new_v[1], new_v[2], 0.0)


@cache
def make_cloth_passes(real: Real, math: str, integrator: str, parts: frozenset[str]) -> dict[str, Kernel]:
    """Compile the kernels of one-force integrators (`step`) or of velocity Verlet (`opening`, `middle`, `closing`).

    Each is kernel(position, velocity, new_position, new_velocity, record, bodies, integers, counter, pass_number, rows,
    columns): flat arrays of quads, the constants, the colliders' rows one after the other, the integer record
    (mass_spring/cloth/point.py), the step counter and the pass's number after it.
    """
    variant = device_variant(real, math, cloth_features(integrator, parts))

    def compiled(name: str, move: Callable) -> Kernel:
        kernel = of_scene(filled(cloth_pass, {"move": move}), integrator, parts)
        label = variant_name(real, math, integrator, parts, name)
        return kernels_of(variant, math, (kernel,), label).cloth_pass

    return {name: compiled(name, move) for name, move in moves_of(integrator).items()}


@cache
def make_cloth_rk4_stages(real: Real, math: str, parts: frozenset[str]) -> list[Kernel]:
    """Compile the four stage kernels of RK4.

    kernel(position, velocity, base_position, base_velocity, total_position, total_velocity, new_position, new_velocity,
    record, bodies, integers, counter, pass_number, rows, columns): neighbours are read in (position, velocity), the
    state of the stage; each stage adds to the total, the last one writes the new state to `new`.
    """

    def compiled(stage: int) -> Kernel:
        variant = device_variant(real, math, {**cloth_features("rk4", parts), "stage": stage})
        kernel = of_scene(filled(cloth_rk4, {"stage_offset": RK4_OFFSETS[stage]}), "rk4", parts)
        return kernels_of(variant, math, (kernel,), variant_name(real, math, parts, stage)).cloth_rk4

    return [compiled(stage) for stage in range(4)]
