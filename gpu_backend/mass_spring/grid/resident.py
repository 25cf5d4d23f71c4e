"""The kernel `resident`: the grid on the chip, for grids that fit there.

A block stores its tile for thousands of steps; every `halo` steps it writes the border of its own masses to device
memory, sets its flag, waits for the flags of its up to eight neighbours and reads its halo again. No barrier of the
whole grid: a block only waits for its neighbours. All blocks must run at once, which a cooperative launch
guarantees.

Two alternating border buffers are enough: a block writes border n + 2 only after it saw its neighbours' flags n + 1,
which they set after they had read border n.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.blocks import PATIENCE, load_fresh_pair, raise_flag, read_flag
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT
from softlab.gpu_backend.core.pairs import store_pair
from softlab.gpu_backend.core.tiling import Tile
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.mass_spring.grid.strips import StripState, pin_bits_of, read_strip
from softlab.gpu_backend.mass_spring.grid.tiles import (
    grid_blocks_together,
    middle,
    on_tiles,
    pair_dtype,
    place_of,
    values_of,
    write,
)
from softlab.gpu_backend.mass_spring.tile_bits import bits_between
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine

FLAG_STRIDE = 32  # int32 between two flags: a 128-byte line each, so that polling one does not slow another


@inlined_routine
def fetch(position, velocity, offset, bits, both, old, state, columns):
    """Read the masses of the strip whose bit is set from the borders of the neighbours: all are loaded before the
    first is waited for."""
    x, y = cuda.local.array(FEATURE.strip, real), cuda.local.array(FEATURE.strip, real)
    if bits != 0:
        for r in range(FEATURE.strip):
            if bits & np.int32(1 << r):
                k = np.int32((state.i + np.int32(r)) * columns + state.j) + offset
                p, v = load_fresh_pair(position, k), load_fresh_pair(velocity, k)
                x[r], y[r], state.vx[r], state.vy[r] = p.real, p.imag, v.real, v.imag
        for r in range(FEATURE.strip):
            if bits & np.int32(1 << r):
                store_pair(both, old + state.place + np.int32(r) * np.int32(FEATURE.tile_columns), x[r], y[r])


@inlined_routine
def wait(flags, failed, wanted):
    """Let threads 0 to 7 of the block each wait for the flag of one neighbour."""
    lane = np.int32(cuda.threadIdx.y * FEATURE.tile_columns + cuda.threadIdx.x)
    if lane < 8:
        turn = lane + 1 if lane > 3 else lane  # 0 ... 8 without 4, which is the block itself
        down = np.int32(cuda.blockIdx.y) + turn // 3 - 1
        across = np.int32(cuda.blockIdx.x) + turn % 3 - 1
        if down >= 0 and down < cuda.gridDim.y and across >= 0 and across < cuda.gridDim.x:
            place = np.int32((down * np.int32(cuda.gridDim.x) + across) * FLAG_STRIDE)
            checks = np.int32(0)
            while np.int32(read_flag(flags, place) - wanted) < 0:
                checks += np.int32(1)
                if checks > PATIENCE or ((checks & 1023) == 0 and read_flag(failed, 0) != 0):
                    raise_flag(failed, 0, np.int32(1))
                    break


@routine
def resident(
    position, velocity, new_position, new_velocity, border_position, border_velocity, flags, epoch, failed, record,
    integers, counter, passes, pinned, rows, columns,
):  # fmt: skip
    parameters = record[0]
    both = cuda.shared.array(0, pair_dtype, alignment=ALIGNMENT)
    vx, vy = cuda.local.array(FEATURE.strip, real), cuda.local.array(FEATURE.strip, real)
    rows, columns = np.int32(rows), np.int32(columns)
    block = np.int32(cuda.blockIdx.y * cuda.gridDim.x + cuda.blockIdx.x)
    i, j, (place, left, right, above, below), owned = place_of(
        np.int32(cuda.blockIdx.y), np.int32(cuda.gridDim.y), rows, columns
    )
    row_first, row_end, column_first, column_end = owned
    owned_rows, border, outside = np.int32(0), np.int32(0), np.int32(0)
    if j < columns:
        rows_owned = bits_between(row_first, row_end, i)
        rows_here = bits_between(np.int32(0), rows, i)
        if j >= column_first and j < column_end:
            owned_rows = rows_owned
        outside = rows_here & ~owned_rows
        inner_first = row_first + FEATURE.halo if row_first > 0 else row_first
        inner_end = row_end - FEATURE.halo if row_end < rows else row_end
        border = owned_rows & ~bits_between(inner_first, inner_end, i)
        if (column_first > 0 and j < column_first + FEATURE.halo) or (
            column_end < columns and j >= column_end - FEATURE.halo
        ):
            border = owned_rows
    values = values_of(parameters)
    read_strip(position, velocity, vx, vy, both, place, Cell(i, j, rows, columns))
    pin_bits = pin_bits_of(pinned, Cell(i, j, rows, columns))
    state = StripState(i, j, place, left, right, above, below, vx, vy, pin_bits)
    cuda.syncthreads()
    old = np.int32(0)
    done = np.int64(0)
    wanted = np.int32(epoch)
    offset = np.int32(0)
    particles = np.int32(rows * columns)
    while True:
        steps = min(np.int64(FEATURE.halo), passes - done)
        old = middle(steps, done, old, both, state, values, integers, counter, rows, columns)
        done += steps
        if done >= passes:
            break
        wanted += np.int32(1)
        write(border_position, border_velocity, offset, border, both, old, state, columns)
        cuda.syncthreads()
        if cuda.threadIdx.x == 0 and cuda.threadIdx.y == 0:
            raise_flag(flags, block * np.int32(FLAG_STRIDE), wanted)
        wait(flags, failed, wanted)
        cuda.syncthreads()
        fetch(border_position, border_velocity, offset, outside, both, old, state, columns)
        cuda.syncthreads()
        offset = particles - offset
    write(new_position, new_velocity, np.int32(0), owned_rows, both, old, state, columns)


@cache
def make_resident(real: Real, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool) -> Kernel:
    """Compile kernel(position, velocity, new_position, new_velocity, border_position, border_velocity, flags, epoch,
    failed, record, integers, counter, passes, pinned, rows, columns): `passes` steps of the whole grid, from the old
    state to the new one.

    `border_*` (2 * particles,): the borders of tiles, two alternating; `flags` (blocks * FLAG_STRIDE,) int32, compared
    with `epoch` + 1, + 2, ... (the caller increases `epoch` by the exchanges of each launch); `failed` (1,) int32 is
    set to 1 by a block whose neighbours never respond. Launched cooperatively, one block per tile.
    """
    variant, kernel = on_tiles(resident, real, math, integrator, parts, tile, cut)
    bounds = (tile.threads, grid_blocks_together(real, tile))
    label = variant_name(real, math, integrator, parts, tile.name, cut)
    return make_kernel(variant.copied(kernel), label, launch_bounds=bounds, **kernel_options(math))
