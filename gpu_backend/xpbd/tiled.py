"""The kernels that project in shared memory: `one-block`, a small sheet that stays there for many steps, and `tiled`.

A block of `tiled` loads its tile with a halo (xpbd/tile.py), does some iterations of all colours and writes its own
masses into other buffers, which the next launch reads: one launch instead of one per colour in `graph`. The first
launch of a substep predicts, including the halo; the last one computes velocities and collisions. No block waits for
another.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.forces import with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.wind import block_air
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.position_based.constraints import constants_of, dampers
from softlab.gpu_backend.position_based.kernels import multiplier_planes
from softlab.gpu_backend.xpbd.sweep import copies, sweep_masses, sweeps, tile_features
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.gpu_backend.xpbd.tile_ends import (
    Tethers,
    attach,
    close_substep,
    load,
    multiplier_moves,
    open_substep,
    store,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, real, routine

NO_PLACE = np.int32(0)

fetch = Open("fetch(multipliers, planes, origin, rows, columns): read a thread's multipliers")
leave = Open("leave(multipliers, planes, origin, rows, columns): write those of owned constraints")
scalar = Open("scalar: the type of numbers in shared memory")
sweep_colours = Open("sweep_colours(shared, before, multipliers, constants, bounds): all colours")


@inlined_routine
def iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns):
    """Return the offset of the final positions in `shared`; `tethers`: a Tethers."""
    old = np.int32(0)
    for _ in range(iterations):
        if FEATURE.jacobi or FEATURE.averaged_jacobi:
            place = constants, bounds, tethers.state, origin, (rows, columns)
            old = sweep_masses(shared, old, before, multipliers, place)
        else:
            sweep_colours(shared, before, multipliers, constants, bounds)
        attach(shared, old, tethers, origin, rows, columns)
    return old


@routine
def one_block(
    position, velocity, anchors, reaches, count, record, bodies, integers, counter, steps, substeps, iterations,
    rows, columns,
):  # fmt: skip
    """Do `steps` steps of the whole sheet, in place."""
    parameters = record[0]
    world = World(parameters, bodies, integers)
    shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
    first_before = np.int32(FEATURE.first_before)
    before = shared[first_before:]
    multipliers = cuda.local.array(FEATURE.registers, real)
    rows, columns = np.int32(rows), np.int32(columns)
    bounds, origin = (NO_PLACE, rows, NO_PLACE, columns), (NO_PLACE, NO_PLACE)
    constants, tethers = constants_of(parameters), Tethers(position, anchors, reaches, count)
    for place in range(steps):
        for substep in range(substeps):
            step, number = clock(counter, place, substeps, substep)
            air = block_air(parameters, integers, number, 0.0)
            for slot in range(FEATURE.registers):
                multipliers[slot] = 0.0
            open_substep(position, velocity, shared, before, origin, world, step, air, rows, columns)
            old = iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns)
            close_substep(shared, old, position, position, velocity, origin, world, number, rows, columns)
            cuda.syncthreads()


@cache
def make_one_block(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Kernel:
    """Compile `one_block`, launched as one block of the tile's threads."""
    return _compiled(one_block, real, math, parts, axes, tile)


@routine
def tiled(
    state, velocity, source, target, new_velocity, planes, new_planes, anchors, reaches, count, record, bodies,
    integers, counter, place, substeps, substep, opening, closing, iterations, rows, columns,
):  # fmt: skip
    """Do some iterations of a substep.

    `state` and `velocity`: positions and velocities at the start of the substep. An `opening` launch starts from them,
    others from `source` and the multipliers of `planes`; a `closing` one writes the new state, others positions and
    multipliers for the next.
    """
    parameters = record[0]
    world = World(parameters, bodies, integers)
    shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
    first_before = np.int32(FEATURE.first_before)
    before = shared[first_before:]
    multipliers = cuda.local.array(FEATURE.registers, real)
    rows, columns = np.int32(rows), np.int32(columns)
    i = np.int32(cuda.blockIdx.y * np.int32(FEATURE.owned_rows) + np.int32(FEATURE.first_row))
    j = np.int32(cuda.blockIdx.x * np.int32(FEATURE.owned_columns) + np.int32(FEATURE.first_column))
    origin = (i, j)
    bounds = (
        np.int32(max(NO_PLACE, -i)), np.int32(min(np.int32(FEATURE.tile_rows), rows - i)),
        np.int32(max(NO_PLACE, -j)), np.int32(min(np.int32(FEATURE.tile_columns), columns - j)),
    )  # fmt: skip
    step, number = clock(counter, place, substeps, substep)
    constants = constants_of(parameters)
    for slot in range(FEATURE.registers):
        multipliers[slot] = 0.0
    if opening:
        air = block_air(parameters, integers, number, 0.0)
        open_substep(state, velocity, shared, before, origin, world, step, air, rows, columns)
    else:
        fetch(multipliers, planes, origin, rows, columns)
        load(source, state, shared, before, origin, rows, columns)
    tethers = Tethers(state, anchors, reaches, count)
    old = iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns)
    if closing:
        close_substep(shared, old, state, target, new_velocity, origin, world, number, rows, columns)
    else:
        store(shared, old, target, origin, rows, columns)
        leave(multipliers, new_planes, origin, rows, columns)


@cache
def make_tiled(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Kernel:
    """Compile `tiled`, launched with one block per tile."""
    return _compiled(tiled, real, math, parts, axes, tile)


def _compiled(kernel: Callable, real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Kernel:
    with_dampers = dampers(parts)
    features = tile_features(parts, axes, tile) | {
        "damped": with_dampers, "multipliers": multiplier_planes(parts),
        "first_before": (copies(parts) - with_dampers) * tile.quads * 4 if with_dampers else 0,
        "first_row": tile.rows.start - tile.rows.before, "first_column": tile.columns.start - tile.columns.before,
    }  # fmt: skip
    names: dict[str, Any] = {
        **multiplier_moves(real, math, parts, axes, tile),
        "iterate": filled(iterate, sweeps(real, math, parts, axes, tile)),
        "scalar": np.dtype(real) if simulated() else real,
    }  # fmt: skip
    copy = device_variant(real, math, features).copied(with_forces(filled(kernel, names), parts))
    name = f"xpbd_{variant_name(real, math, axes, parts, tile.name)}"
    return make_kernel(copy, name, launch_bounds=(tile.threads, 1), **kernel_options(math))
