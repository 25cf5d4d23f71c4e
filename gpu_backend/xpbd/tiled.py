"""The kernels that project in shared memory: `one-block`, a small sheet that stays there for many steps, and `tiled`.

A block of `tiled` loads its tile with a halo (xpbd/tile.py), does some iterations of all colours and writes its own
masses into other buffers, which the next launch reads: one launch instead of one per colour in `graph`. The first
launch of a substep predicts, including the halo; the last one computes velocities and collisions. No block waits for
another.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT, simulated
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.wind import make_block_air
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.position_based.constraints import dampers, make_constants
from softlab.gpu_backend.xpbd.sweep import copies, make_jacobi_sweep, make_sweep, register_multipliers
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.gpu_backend.xpbd.tile_ends import Tethers, make_multiplier_moves, make_tile_ends
from softlab.model.base.types import Real
from softlab.model.position_based.plan import families


@cache
def make_iterate(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Callable:
    """Make iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns), which
    returns the offset of the final positions in `shared`. `tethers`: a Tethers."""
    attach = make_tile_ends(real, math, parts, axes, tile).attach
    colours = "gauss-seidel" in parts
    sweep = make_sweep(real, math, parts, axes, tile) if colours else None
    jacobi_sweep = None if colours else make_jacobi_sweep(real, math, parts, axes, tile)
    some, inline = bool(families(parts)), inlined(math)

    if colours or not some:
        sweep = sweep or make_sweep(real, math, parts, axes, tile)

        @inline
        def iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns):
            old = np.int32(0)
            for _ in range(iterations):
                sweep(shared, before, multipliers, constants, bounds)
                attach(shared, old, tethers, origin, rows, columns)
            return old
    else:

        @inline
        def iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns):
            old = np.int32(0)
            for _ in range(iterations):
                old = jacobi_sweep(
                    shared, old, before, multipliers, constants, bounds, tethers.state, origin, rows, columns
                )  # fmt: skip
                attach(shared, old, tethers, origin, rows, columns)
            return old

    return iterate


@cache
def make_one_block(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Kernel:
    """Compile one_block(position, velocity, anchors, reaches, count, record, bodies, integers, counter, steps,
    substeps, iterations, rows, columns): `steps` steps of the whole sheet, in place. Launched as one block of the
    tile's threads."""
    ends, iterate = make_tile_ends(real, math, parts, axes, tile), make_iterate(real, math, parts, axes, tile)
    open_substep, close_substep = ends.open_substep, ends.close_substep
    constants_of, clock, block_air = make_constants(math), make_clock(math, parts), make_block_air(real, math, parts)
    register_count, scalar = register_multipliers(parts, tile), np.dtype(real) if simulated() else real
    before_place = np.int32((copies(parts) - dampers(parts)) * tile.quads * 4 if dampers(parts) else 0)
    zero, no_place = real(0), np.int32(0)

    def one_block(
        position, velocity, anchors, reaches, count, record, bodies, integers, counter, steps, substeps, iterations,
        rows, columns,
    ):  # fmt: skip
        parameters = record[0]
        world = World(parameters, bodies, integers)
        shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
        before = shared[before_place:]
        multipliers = cuda.local.array(register_count, real)
        rows, columns = np.int32(rows), np.int32(columns)
        bounds, origin = (no_place, rows, no_place, columns), (no_place, no_place)
        constants, tethers = constants_of(parameters), Tethers(position, anchors, reaches, count)
        for place in range(steps):
            for substep in range(substeps):
                step, number = clock(counter, place, substeps, substep)
                air = block_air(parameters, integers, number, zero)
                for slot in range(register_count):
                    multipliers[slot] = zero
                open_substep(position, velocity, shared, before, origin, world, step, air, rows, columns)
                old = iterate(
                    iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns
                )
                close_substep(
                    shared, old, position, position, velocity, origin, world, number, rows, columns
                )  # fmt: skip
                cuda.syncthreads()

    name = f"xpbd_{variant_name(real, math, axes, parts, tile.name)}"
    return make_kernel(one_block, name, launch_bounds=(tile.threads, 1), **kernel_options(math))


@cache
def make_tiled(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Kernel:
    """Compile tiled(state, velocity, source, target, new_velocity, planes, new_planes, anchors, reaches, count, record,
    bodies, integers, counter, place, substeps, substep, opening, closing, iterations, rows, columns): some iterations
    of a substep.

    `state` and `velocity`: positions and velocities at the start of the substep. An `opening` launch starts from them,
    others from `source` and the multipliers of `planes`; a `closing` one writes the new state, others positions and
    multipliers for the next. One block per tile.
    """
    ends, iterate = make_tile_ends(real, math, parts, axes, tile), make_iterate(real, math, parts, axes, tile)
    moves = make_multiplier_moves(real, math, parts, axes, tile)
    open_substep, load, store, close_substep = ends.open_substep, ends.load, ends.store, ends.close_substep
    fetch, leave = moves.fetch, moves.leave
    constants_of, clock, block_air = make_constants(math), make_clock(math, parts), make_block_air(real, math, parts)
    register_count, scalar = register_multipliers(parts, tile), np.dtype(real) if simulated() else real
    before_place = np.int32((copies(parts) - dampers(parts)) * tile.quads * 4 if dampers(parts) else 0)
    first_row, first_column = (
        np.int32(tile.rows.start - tile.rows.before),
        np.int32(tile.columns.start - tile.columns.before),
    )
    step_down, step_across = np.int32(tile.rows.owned), np.int32(tile.columns.owned)
    size_down, size_across = np.int32(tile.rows.size), np.int32(tile.columns.size)
    zero, no_place = real(0), np.int32(0)

    def tiled(
        state, velocity, source, target, new_velocity, planes, new_planes, anchors, reaches, count, record, bodies,
        integers, counter, place, substeps, substep, opening, closing, iterations, rows, columns,
    ):  # fmt: skip
        parameters = record[0]
        world = World(parameters, bodies, integers)
        shared = cuda.shared.array(0, scalar, alignment=ALIGNMENT)
        before = shared[before_place:]
        multipliers = cuda.local.array(register_count, real)
        rows, columns = np.int32(rows), np.int32(columns)
        i = np.int32(cuda.blockIdx.y * step_down + first_row)
        j = np.int32(cuda.blockIdx.x * step_across + first_column)
        origin = (i, j)
        bounds = (
            np.int32(max(no_place, -i)), np.int32(min(size_down, rows - i)),
            np.int32(max(no_place, -j)), np.int32(min(size_across, columns - j)),
        )  # fmt: skip
        step, number = clock(counter, place, substeps, substep)
        constants = constants_of(parameters)
        for slot in range(register_count):
            multipliers[slot] = zero
        if opening:
            air = block_air(parameters, integers, number, zero)
            open_substep(state, velocity, shared, before, origin, world, step, air, rows, columns)
        else:
            fetch(multipliers, planes, origin, rows, columns)
            load(source, state, shared, before, origin, rows, columns)
        tethers = Tethers(state, anchors, reaches, count)
        old = iterate(iterations, shared, before, multipliers, constants, bounds, tethers, origin, rows, columns)
        if closing:
            close_substep(
                shared, old, state, target, new_velocity, origin, world, number, rows, columns
            )  # fmt: skip
        else:
            store(shared, old, target, origin, rows, columns)
            leave(multipliers, new_planes, origin, rows, columns)

    name = f"xpbd_{variant_name(real, math, axes, parts, tile.name)}"
    return make_kernel(tiled, name, launch_bounds=(tile.threads, 1), **kernel_options(math))
