"""Kernels on tiles: one block for the whole grid, and many steps per pass.

Variants made of the same step of a tile (mass_spring/grid/strips.py):

- `one-block`: the grid is one tile; all steps in one launch, one barrier per step, nothing else.
- `tiles`: for grids that do not fit on the chip. A launch reads each tile with its halo, does as many steps as the halo
  has rings, and writes the masses that the tile owns: data passes through memory once for several steps, but the halos
  are computed twice.
- `resident`: for grids that fit on the chip; see resident.py.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.device import ALIGNMENT
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.pairs import load_pair, store_pair
from softlab.gpu_backend.core.tiling import Tile, blocks_together
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.mass_spring.grid.point import current_step, grid_features, moves_of
from softlab.gpu_backend.mass_spring.grid.strips import (
    ON_TILES,
    StripState,
    pair_type,
    pin_bits_of,
    read_strip,
    shared_bytes,
    step_strip,
)
from softlab.gpu_backend.mass_spring.tile_bits import bits_between, tile_features
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, Variant, filled, inlined_routine, real, routine, unrolled

Values, NUMBERS = namedtuple("Values", ON_TILES), len(ON_TILES)
opening = Open("opening: as `middle`, of velocity Verlet's first pass")
middle = Open("middle: `run_steps` of a pass")
closing = Open("closing: as `middle`, of velocity Verlet's last pass")
pair_dtype = Open("pair_dtype: of strips.pair_type")


@inlined_routine
def values_of(parameters):
    """Return the record's values. A loop keeps those in registers, and would read the record again after each barrier."""
    return Values(*tuple(parameters[ON_TILES[n]] for n in unrolled(NUMBERS)))


@inlined_routine
def axis(index, count, masses, size):
    """Return tiling.owned in the kernel's integers."""
    start = np.int32(index * np.int32(size - 2 * FEATURE.halo))
    first, end = start, np.int32(masses)
    if index > 0:
        first = np.int32(start + FEATURE.halo)
    if index < count - 1:
        end = np.int32(start + size - FEATURE.halo)
    return start, first, end


@inlined_routine
def neighbours(cell):
    """Return (place, left, right, above, below): indices of the strip in shared memory, and of its neighbours.

    At the edge of the grid or of the tile a mass replaces its neighbour, and does not pull itself.
    """
    width = np.int32(FEATURE.tile_columns)
    i, j, rows, columns = cell.i, cell.j, cell.rows, cell.columns
    down, across = np.int32(cuda.threadIdx.y), np.int32(cuda.threadIdx.x)
    place = np.int32(down * np.int32(FEATURE.strip * width) + across)
    left, right = np.int32(-1), np.int32(1)
    if across == 0 or j == 0:
        left = np.int32(0)
    if across == width - 1 or j >= columns - 1:
        right = np.int32(0)
    above, below = place, np.int32(place + (FEATURE.strip - 1) * width)
    if down > 0 and i > 0:
        above = np.int32(place - width)
    if down < FEATURE.tile_rows // FEATURE.strip - 1 and i + FEATURE.strip < rows:
        below = np.int32(below + width)
    return place, left, right, above, below


@inlined_routine
def place_of(number, count, rows, columns):
    """Return (row and column of the thread's strip, its index and its neighbours', rows and columns that the block
    owns), in row of tiles `number` of `count`."""
    row_start, row_first, row_end = axis(number, count, rows, FEATURE.tile_rows)
    column_start, column_first, column_end = axis(
        np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x), columns, np.int32(FEATURE.tile_columns)
    )
    i = np.int32(row_start + np.int32(cuda.threadIdx.y) * FEATURE.strip)
    j = np.int32(column_start + np.int32(cuda.threadIdx.x))
    return i, j, neighbours(Cell(i, j, rows, columns)), (row_first, row_end, column_first, column_end)


@inlined_routine
def run_steps(steps, number, old, both, state, parameters, integers, counter, rows, columns):
    """Do `steps` steps from the copy of the positions at `old`; returns the offset of the newest copy."""
    for _ in range(steps):
        new = np.int32(np.int32(FEATURE.tile_columns * FEATURE.tile_rows) - old)
        now = current_step(counter, number)
        step_strip(both, old, new, state, parameters, integers, now, rows, columns)
        cuda.syncthreads()
        old = new
        number += 1
    return old


@inlined_routine
def write(position, velocity, offset, bits, both, old, state, columns):
    """Store the masses of the strip whose bit is set."""
    width = np.int32(FEATURE.tile_columns)
    if bits != 0:
        for r in range(FEATURE.strip):
            if bits & np.int32(1 << r):
                k = np.int32((state.i + np.int32(r)) * columns + state.j) + offset
                p = load_pair(both, old + state.place + np.int32(r) * width)
                store_pair(position, k, p.real, p.imag)
                store_pair(velocity, k, state.vx[r], state.vy[r])


@routine
def tile_pass(
    position, velocity, new_position, new_velocity, record, integers, counter, pass_number, passes, pinned, rows,
    columns, first, count,
):  # fmt: skip
    parameters = record[0]
    both = cuda.shared.array(0, pair_dtype, alignment=ALIGNMENT)
    vx, vy = cuda.local.array(FEATURE.strip, real), cuda.local.array(FEATURE.strip, real)
    rows, columns = np.int32(rows), np.int32(columns)
    number = np.int32(np.int32(cuda.blockIdx.y) + first)
    i, j, (place, left, right, above, below), owned = place_of(number, np.int32(count), rows, columns)
    row_first, row_end, column_first, column_end = owned
    values = values_of(parameters)
    read_strip(position, velocity, vx, vy, both, place, Cell(i, j, rows, columns))
    pin_bits = pin_bits_of(pinned, Cell(i, j, rows, columns))
    state = StripState(i, j, place, left, right, above, below, vx, vy, pin_bits)
    cuda.syncthreads()
    old = np.int32(0)
    if FEATURE.verlet and FEATURE.whole:
        old = opening(1, pass_number, old, both, state, values, integers, counter, rows, columns)
        pass_number += 1
        passes -= 2
    old = middle(passes, pass_number, old, both, state, values, integers, counter, rows, columns)
    if FEATURE.verlet and FEATURE.whole:
        old = closing(1, pass_number + passes, old, both, state, values, integers, counter, rows, columns)
    if j >= column_first and j < column_end:
        owned_rows = bits_between(row_first, row_end, i)
        write(new_position, new_velocity, np.int32(0), owned_rows, both, old, state, columns)


def grid_blocks_together(real: Real, tile: Tile) -> int:
    """Return the number of blocks that should fit on a multiprocessor, with 64 registers a thread (128 in float64)."""
    return blocks_together(tile, shared_bytes(real, tile), 64 if real is np.float32 else 128)


def on_tiles(
    kernel: Callable, real: Real, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool,
    whole: bool = False,
) -> tuple[Variant, Callable]:  # fmt: skip
    """Return the variant of a kernel on tiles, and the kernel with its open names replaced."""
    features = {**grid_features(integrator, parts), **tile_features(tile), "cut": cut, "whole": whole}
    moves = moves_of(integrator, parts)
    runs = {name: filled(run_steps, {"move": move}) for name, move in moves.items() if name != "step"}
    names: dict[str, object] = {**runs} or {"middle": filled(run_steps, {"move": moves["step"]})}
    names |= {"pair_dtype": pair_type(real)}
    return device_variant(real, math, features), filled(kernel, names)


@cache
def make_tile_pass(
    real: Real, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool, whole: bool = False
) -> Kernel:
    """Compile kernel(position, velocity, new_position, new_velocity, record, integers, counter, pass_number, passes,
    pinned, rows, columns, first, count): `passes` (at most tile.halo) passes of some rows of tiles, from the old state
    to the new.

    Launched with one block per tile, blocks of (tile.columns, tile.strips) threads, from row of tiles `first` of
    `count` on. `whole`: the grid is one tile; then any number of passes is done, and velocity Verlet's first and last
    are its opening and its closing.
    """
    variant, kernel = on_tiles(tile_pass, real, math, integrator, parts, tile, cut, whole)
    bounds = (tile.threads, 1 if whole else grid_blocks_together(real, tile))
    label = variant_name(real, math, integrator, parts, tile.name, cut, whole)
    return make_kernel(variant.copied(kernel), label, launch_bounds=bounds, **kernel_options(math))
