"""Kernels on tiles: one block for the whole grid, many steps a pass, and the grid kept on the chip.

Three rungs of one ladder, made of the same step of a tile (mass_spring/grid/strips.py):

- `one-block`: the grid is one tile; all steps in one launch, one barrier a step, nothing else.
- `tiles`: for grids that do not fit on the chip. A launch reads each tile with its halo, does as many steps as the halo
  has rings, and writes what the tile owns: memory is passed once for several steps, at the price of computing the halos
  twice.
- `resident`: for grids that fit on the chip all together. A block keeps its tile for thousands of steps; every `halo`
  steps it writes the border of what it owns to device memory, raises its flag, waits for the flags of its up to eight
  neighbours and reads its halo anew. No barrier of the whole grid: a block waits for its neighbours only. All blocks
  must run at once, which a cooperative launch guarantees.

Two border buffers in turn are enough: a block writes border n + 2 only after it saw its neighbours' flags n + 1, which
they raised after they had read border n.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.blocks import load_fresh_pair, raise_flag, read_flag
from gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from gpu_backend.core.device import simulated
from gpu_backend.core.pairs import load_pair, store_pair
from gpu_backend.core.tiling import Tile
from gpu_backend.mass_spring.grid.point import make_moves, make_point_functions
from gpu_backend.mass_spring.grid.strips import ALIGNMENT, make_strips, pair_type, shared_bytes

FLAG_STRIDE = 32  # int32 between two flags: a 128-byte line each, so that polling one does not slow another
SHARED_MEMORY = 227 << 10  # bytes of a multiprocessor (compute capability 9.0; smaller ones hold fewer blocks)
PATIENCE = 1 << 22  # looks at a flag, seconds of them, before a block gives up


@cache
def _make_parts(real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool) -> Any:
    """Device functions that the kernels share: where a thread's strip lies, to run steps, to write what is owned."""
    strips = make_strips(real, math, integrator, parts, tile, cut)
    strip, width, height, halo = tile.strip, np.int32(tile.columns), tile.rows, tile.halo
    half = np.int32(tile.masses)
    current_step = make_point_functions(real, math, integrator, parts).current_step
    inline = inlined(math)

    @inline
    def axis(index, count, masses, size):
        """tiling.owned in the kernel's integers."""
        start = np.int32(index * np.int32(size - 2 * halo))
        first, end = start, np.int32(masses)
        if index > 0:
            first = np.int32(start + halo)
        if index < count - 1:
            end = np.int32(start + size - halo)
        return start, first, end

    @inline
    def neighbours(i, j, rows, columns):
        """(place, left, right, above, below): of the strip in shared memory, and where its neighbours lie; at the edge
        of the grid or of the tile a mass stands in for its neighbour, and does not pull itself."""
        down, across = np.int32(cuda.threadIdx.y), np.int32(cuda.threadIdx.x)
        place = np.int32(down * np.int32(strip * width) + across)
        left, right = np.int32(-1), np.int32(1)
        if across == 0 or j == 0:
            left = np.int32(0)
        if across == width - 1 or j >= columns - 1:
            right = np.int32(0)
        above, below = place, np.int32(place + (strip - 1) * width)
        if down > 0 and i > 0:
            above = np.int32(place - width)
        if down < height // strip - 1 and i + strip < rows:
            below = np.int32(below + width)
        return place, left, right, above, below

    def make_run(move: Any) -> Any:
        step = strips.make_step(move)

        @inline
        def run(
            steps, number, old, both, vx, vy, held, place, left, right, above, below, i, j, record, integers, counter,
            rows, columns,
        ):  # fmt: skip
            """`steps` steps from the copy of the positions at `old`; returns where the newest copy lies."""
            for _ in range(steps):
                new = np.int32(half - old)
                now = current_step(counter, number)
                step(
                    both, old, new, vx, vy, held, place, left, right, above, below, i, j, record, integers, now,
                    rows, columns,
                )  # fmt: skip
                cuda.syncthreads()
                old = new
                number += 1
            return old

        return run

    @inline
    def write(position, velocity, offset, bits, both, old, place, vx, vy, i, j, columns):
        """Store the masses of the strip whose bit is set."""
        if bits != 0:
            for r in range(strip):
                if bits & np.int32(1 << r):
                    k = np.int32((i + np.int32(r)) * columns + j) + offset
                    p = load_pair(both, old + place + np.int32(r) * width)
                    store_pair(position, k, p.real, p.imag)
                    store_pair(velocity, k, vx[r], vy[r])

    @inline
    def bits_between(first, end, i):
        """Bit r set where first <= i + r < end."""
        bits = np.int32(0)
        for r in range(strip):
            row = i + np.int32(r)
            if row >= first and row < end:
                bits = bits | np.int32(1 << r)
        return bits

    moves = make_moves(real, math, integrator, parts)
    runs = {name: make_run(move) for name, move in moves.items()}
    return SimpleNamespace(
        constants=strips.constants, read=strips.read, held_bits=strips.held_bits, axis=axis,
        neighbours=neighbours, runs=runs, write=write, bits_between=bits_between,
    )  # fmt: skip


def blocks_together(real: Any, tile: Tile) -> int:
    """Blocks that should fit on a multiprocessor, so that one computes while another waits for memory or neighbours:
    as many as shared memory holds, and as leave a thread 64 registers (128 in float64)."""
    if simulated():  # one after another
        return 1
    threads = 1024 if real is np.float32 else 512
    return max(1, min(SHARED_MEMORY // shared_bytes(real, tile), threads // tile.threads))


@cache
def make_tile_pass(
    real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool, whole: bool = False
) -> Any:
    """kernel(position, velocity, new_position, new_velocity, record, integers, counter, pass_number, passes, pinned,
    rows, columns): `passes` (at most tile.halo) passes of every tile, from the old state to the new one.

    Launched with one block a tile, blocks of (tile.columns, tile.strips) threads. `whole`: the grid is one tile;
    then any number of passes is done, and velocity Verlet's first and last are its opening and its closing.
    """
    f = _make_parts(real, math, integrator, parts, tile, cut)
    constants, read, held_bits, axis, neighbours = f.constants, f.read, f.held_bits, f.axis, f.neighbours
    write, bits_between = f.write, f.bits_between
    verlet = "middle" in f.runs
    run = f.runs["middle"] if verlet else f.runs["step"]
    opening, closing = f.runs.get("opening", run), f.runs.get("closing", run)
    ends = verlet and whole
    strip, width, height = tile.strip, tile.columns, tile.rows
    pair = pair_type(real)
    zero = np.int32(0)

    def tile_pass(
        position, velocity, new_position, new_velocity, record, integers, counter, pass_number, passes, pinned, rows,
        columns,
    ):  # fmt: skip
        both = cuda.shared.array(0, pair, alignment=ALIGNMENT)
        vx, vy = cuda.local.array(strip, real), cuda.local.array(strip, real)
        rows, columns = np.int32(rows), np.int32(columns)
        row_start, row_first, row_end = axis(np.int32(cuda.blockIdx.y), np.int32(cuda.gridDim.y), rows, height)
        column_start, column_first, column_end = axis(
            np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x), columns, width
        )
        i = np.int32(row_start + np.int32(cuda.threadIdx.y) * strip)
        j = np.int32(column_start + np.int32(cuda.threadIdx.x))
        place, left, right, above, below = neighbours(i, j, rows, columns)
        values = constants(record)
        read(position, velocity, vx, vy, both, place, i, j, rows, columns)
        held = held_bits(pinned, i, j, rows, columns)
        cuda.syncthreads()
        old = zero
        if ends:
            old = opening(
                1, pass_number, old, both, vx, vy, held, place, left, right, above, below, i, j, values, integers,
                counter, rows, columns,
            )  # fmt: skip
            pass_number += 1
            passes -= 2
        old = run(
            passes, pass_number, old, both, vx, vy, held, place, left, right, above, below, i, j, values, integers,
            counter, rows, columns,
        )  # fmt: skip
        if ends:
            old = closing(
                1, pass_number + passes, old, both, vx, vy, held, place, left, right, above, below, i, j, values,
                integers, counter, rows, columns,
            )  # fmt: skip
        if j >= column_first and j < column_end:
            mine = bits_between(row_first, row_end, i)
            write(new_position, new_velocity, zero, mine, both, old, place, vx, vy, i, j, columns)

    bounds = (tile.threads, 1 if whole else blocks_together(real, tile))
    variant = variant_name(real, math, integrator, parts, tile.name, cut, whole)
    return make_kernel(tile_pass, variant, launch_bounds=bounds, **kernel_options(math))


@cache
def make_resident(real: Any, math: str, integrator: str, parts: frozenset[str], tile: Tile, cut: bool) -> Any:
    """kernel(position, velocity, new_position, new_velocity, border_position, border_velocity, flags, epoch, failed,
    record, integers, counter, passes, pinned, rows, columns): `passes` steps of the whole grid, from the old state to
    the new one.

    `border_*` (2 * particles,): the borders of tiles, two in turn; `flags` (blocks * FLAG_STRIDE,) int32, compared with
    `epoch` + 1, + 2, ... (the caller raises `epoch` by the exchanges of each launch); `failed` (1,) int32 is set to 1 by
    a block whose neighbours never answer. Launched cooperatively, one block a tile.
    """
    f = _make_parts(real, math, integrator, parts, tile, cut)
    constants, read, held_bits, axis, neighbours = f.constants, f.read, f.held_bits, f.axis, f.neighbours
    write, bits_between = f.write, f.bits_between
    run = f.runs["middle"] if "middle" in f.runs else f.runs["step"]
    strip, width, height, halo = tile.strip, tile.columns, tile.rows, tile.halo
    pair = pair_type(real)
    row_length = np.int32(width)
    inline = inlined(math)

    @inline
    def fetch(position, velocity, offset, bits, vx, vy, both, old, place, i, j, columns):
        """Read the masses of the strip whose bit is set from the borders of the neighbours: all are asked for before
        the first is waited for."""
        x, y = cuda.local.array(strip, real), cuda.local.array(strip, real)
        if bits != 0:
            for r in range(strip):
                if bits & np.int32(1 << r):
                    k = np.int32((i + np.int32(r)) * columns + j) + offset
                    p, v = load_fresh_pair(position, k), load_fresh_pair(velocity, k)
                    x[r], y[r], vx[r], vy[r] = p.real, p.imag, v.real, v.imag
            for r in range(strip):
                if bits & np.int32(1 << r):
                    store_pair(both, old + place + np.int32(r) * row_length, x[r], y[r])

    @inline
    def wait(flags, failed, wanted):
        """Threads 0 to 7 of the block each wait for the flag of one neighbour."""
        lane = np.int32(cuda.threadIdx.y * width + cuda.threadIdx.x)
        if lane < 8:
            turn = lane + 1 if lane > 3 else lane  # 0 ... 8 without 4, which is the block itself
            down = np.int32(cuda.blockIdx.y) + turn // 3 - 1
            across = np.int32(cuda.blockIdx.x) + turn % 3 - 1
            if down >= 0 and down < cuda.gridDim.y and across >= 0 and across < cuda.gridDim.x:
                place = np.int32((down * np.int32(cuda.gridDim.x) + across) * FLAG_STRIDE)
                looks = np.int32(0)
                while np.int32(read_flag(flags, place) - wanted) < 0:
                    looks += np.int32(1)
                    if looks > PATIENCE or ((looks & 1023) == 0 and read_flag(failed, 0) != 0):
                        raise_flag(failed, 0, np.int32(1))
                        break

    def resident(
        position, velocity, new_position, new_velocity, border_position, border_velocity, flags, epoch, failed, record,
        integers, counter, passes, pinned, rows, columns,
    ):  # fmt: skip
        both = cuda.shared.array(0, pair, alignment=ALIGNMENT)
        vx, vy = cuda.local.array(strip, real), cuda.local.array(strip, real)
        rows, columns = np.int32(rows), np.int32(columns)
        block = np.int32(cuda.blockIdx.y * cuda.gridDim.x + cuda.blockIdx.x)
        row_start, row_first, row_end = axis(np.int32(cuda.blockIdx.y), np.int32(cuda.gridDim.y), rows, height)
        column_start, column_first, column_end = axis(
            np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x), columns, width
        )
        i = np.int32(row_start + np.int32(cuda.threadIdx.y) * strip)
        j = np.int32(column_start + np.int32(cuda.threadIdx.x))
        place, left, right, above, below = neighbours(i, j, rows, columns)
        mine, border, outside = np.int32(0), np.int32(0), np.int32(0)
        if j < columns:
            rows_mine = bits_between(row_first, row_end, i)
            rows_here = bits_between(np.int32(0), rows, i)
            if j >= column_first and j < column_end:
                mine = rows_mine
            outside = rows_here & ~mine
            inner_first = row_first + halo if row_first > 0 else row_first
            inner_end = row_end - halo if row_end < rows else row_end
            border = mine & ~bits_between(inner_first, inner_end, i)
            if (column_first > 0 and j < column_first + halo) or (column_end < columns and j >= column_end - halo):
                border = mine
        values = constants(record)
        read(position, velocity, vx, vy, both, place, i, j, rows, columns)
        held = held_bits(pinned, i, j, rows, columns)
        cuda.syncthreads()
        old = np.int32(0)
        done = np.int64(0)
        wanted = np.int32(epoch)
        offset = np.int32(0)
        particles = np.int32(rows * columns)
        while True:
            steps = min(np.int64(halo), passes - done)
            old = run(
                steps, done, old, both, vx, vy, held, place, left, right, above, below, i, j, values, integers,
                counter, rows, columns,
            )  # fmt: skip
            done += steps
            if done >= passes:
                break
            wanted += np.int32(1)
            write(border_position, border_velocity, offset, border, both, old, place, vx, vy, i, j, columns)
            cuda.syncthreads()
            if cuda.threadIdx.x == 0 and cuda.threadIdx.y == 0:
                raise_flag(flags, block * np.int32(FLAG_STRIDE), wanted)
            wait(flags, failed, wanted)
            cuda.syncthreads()
            fetch(border_position, border_velocity, offset, outside, vx, vy, both, old, place, i, j, columns)
            cuda.syncthreads()
            offset = particles - offset
        write(new_position, new_velocity, np.int32(0), mine, both, old, place, vx, vy, i, j, columns)

    bounds = (tile.threads, blocks_together(real, tile))
    variant = variant_name(real, math, integrator, parts, tile.name, cut)
    return make_kernel(resident, variant, launch_bounds=bounds, **kernel_options(math))
