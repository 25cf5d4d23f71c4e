"""An iteration over all constraints of a tile in a block's shared memory, as device functions.

A thread processes the same constraints in every iteration, so their multipliers stay in its registers: an array of
numbers whose loops the compiler unrolls (tests/kernels/ptx_rows.py: nothing is left in local memory).
After each colour the block's threads synchronise; no colour is a launch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.position_based.constraints import KINDS, compliant, dampers, make_pair
from softlab.gpu_backend.position_based.gather import make_gather
from softlab.gpu_backend.position_based.kernels import compact_shape
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.model.base.types import Real
from softlab.model.position_based.plan import Family, colour_order


def masses_each(tile: SheetTile) -> int:
    """Return the number of masses of a thread."""
    return -(-tile.rows.size * tile.columns.size // tile.threads)


def colour_slots(tile: SheetTile, family: Family) -> int:
    """Return the number of constraints of a thread, of one colour of a family."""
    rows, columns = compact_shape(family, tile.rows.size, tile.columns.size)
    return -(-rows * columns // tile.threads)


def register_multipliers(parts: frozenset[str], tile: SheetTile) -> int:
    """Return the number of multipliers that a thread stores; at least 1, since no array is empty."""
    if "gauss-seidel" in parts:
        slots = (colour_slots(tile, family) for family, _ in colour_order(parts) if compliant(parts, family))
        return max(1, sum(slots))
    soft = sum(f"{kind}-compliance" in parts for kind in KINDS)
    return max(1, 4 * soft * masses_each(tile))


def copies(parts: frozenset[str]) -> int:
    """Return the number of arrays of quads in shared memory: the positions, for Jacobi twice, and those before the
    substep for dampers."""
    return (1 if "gauss-seidel" in parts else 2) + dampers(parts)


def shared_bytes(real: Real, parts: frozenset[str], tile: SheetTile) -> int:
    """Return the bytes of shared memory of a block with this tile."""
    return copies(parts) * tile.quads * 4 * np.dtype(real).itemsize


@cache
def make_lattice(math: str, height: int, width: int, down_columns: bool) -> Callable:
    """Make spot(item) -> (i, j): item number of height x width, along rows, or down columns so that the threads of a
    warp are below one another: with an odd pitch neither direction has bank conflicts."""
    across, down = np.uint32(width), np.uint32(height)

    @inlined(math)
    def spot(item):
        number = np.uint32(item)
        if down_columns:
            return np.int32(number % down), np.int32(number // down)
        return np.int32(number // across), np.int32(number % across)

    return spot


@cache
def make_constraint_place(math: str, tile: SheetTile, family: Family, colour: int) -> Callable:
    """Make constraint_place(slot) -> (true if it exists, i, j) of a thread's constraint of a colour, within the
    tile."""
    by_rows = family.rows > 0
    rows, columns = compact_shape(family, tile.rows.size, tile.columns.size)
    spot = make_lattice(math, rows, columns, not by_rows)
    stride = family.rows if by_rows else family.columns
    phase = tile.rows.phase if by_rows else tile.columns.phase
    shift = np.int32(stride * ((colour - phase // stride) % 2))
    items, threads, stride, two = np.int32(rows * columns), np.int32(tile.threads), np.int32(stride), np.int32(2)

    @inlined(math)
    def constraint_place(slot):
        item = np.int32(cuda.threadIdx.x + slot * threads)
        i, j = spot(item)
        if by_rows:
            i = np.int32(two * i - i % stride + shift)
        else:
            j = np.int32(two * j - j % stride + shift)
        return item < items, i, j

    return constraint_place


@cache
def make_colour_sweep(
    real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile, family: Family, colour: int,
    first_slot: int,
) -> Callable:  # fmt: skip
    """Make sweep(positions, before, multipliers, constants, bounds): one colour, with a barrier at its end.

    `bounds`: (first row, end, first column, end) of the tile's masses that are on the sheet. Multipliers begin at
    `first_slot`.
    """
    pair = make_pair(real, math, parts, family, colour, axes)
    constraint_place = make_constraint_place(math, tile, family, colour)
    slots, has_multiplier = colour_slots(tile, family), compliant(parts, family)
    down, along, rising = np.int32(family.rows), np.int32(abs(family.columns)), family.columns < 0
    pitch, zero = np.int32(tile.pitch), real(0)

    @inlined(math)
    def sweep(positions, before, multipliers, constants, bounds):
        for slot in range(slots):
            there, i, j = constraint_place(slot)
            if there and i >= bounds[0] and i + down < bounds[1] and j >= bounds[2] and j + along < bounds[3]:
                here = np.int32(i * pitch + j)
                first, second = here, np.int32(here + down * pitch + along)
                if rising:
                    first, second = np.int32(here + along), np.int32(here + down * pitch)
                multiplier = zero
                if has_multiplier:
                    multiplier = multipliers[first_slot + slot]
                multiplier = pair(positions, before, first, second, multiplier, constants)
                if has_multiplier:
                    multipliers[first_slot + slot] = multiplier
        cuda.syncthreads()

    return sweep


def chained(math: str, functions: Sequence[Any]) -> Callable:
    """Make a device function that calls all of them, in order, with its five arguments."""
    inline = inlined(math)
    if not functions:

        @inline
        def nothing(a, b, c, d, e):
            pass

        return nothing
    head, rest = functions[0], chained(math, functions[1:])

    @inline
    def both(a, b, c, d, e):
        head(a, b, c, d, e)
        rest(a, b, c, d, e)

    return both


@cache
def make_sweep(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Callable:
    """Make sweep(positions, before, multipliers, constants, bounds): all colours of Gauss-Seidel."""
    functions, slot = [], 0
    for family, colour in colour_order(parts):
        functions.append(make_colour_sweep(real, math, parts, axes, tile, family, colour, slot))
        slot += colour_slots(tile, family) * compliant(parts, family)
    return chained(math, functions)


@cache
def make_jacobi_sweep(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> Callable:
    """Make sweep(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns): one Jacobi
    iteration.

    It goes from the copy that begins at quad `old` into the other one, and returns the start of the new positions.
    Weights are those of `state`, in device memory; `origin` is the tile's position (i, j) in the sheet. The tile treats
    its edge as the sheet's: the resulting errors stay in the halo.
    """
    jacobi = make_gather(real, math, parts, axes)
    gather, arrive, valence_of = jacobi.gather, jacobi.arrive, jacobi.valence_of
    each, averages = masses_each(tile), "averaged-jacobi" in parts
    spot = make_lattice(math, tile.rows.size, tile.columns.size, False)
    slots = register_multipliers(parts, tile) // each
    masses, threads = np.int32(tile.rows.size * tile.columns.size), np.int32(tile.threads)
    pitch, quads, one, zero = np.int32(tile.pitch), np.int32(tile.quads), np.int32(1), real(0)
    inline = inlined(math)

    def make_move(slot: int) -> Callable:
        """Make the move of one of a thread's masses. Each is a separate function: in a loop, which the compiler does
        not unroll around so much code, multipliers would be in local memory."""
        first_item, first = np.int32(slot * threads), np.int32(slot * slots)

        @inline
        def move(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns):
            item = np.int32(cuda.threadIdx.x + first_item)
            i, j = spot(item)
            if item < masses and i >= bounds[0] and i < bounds[1] and j >= bounds[2] and j < bounds[3]:
                here = np.int32(i * pitch + j)
                row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
                p, b = load_quad(positions, old + here), load_quad(before, here)
                cell = Cell(
                    np.int32(i - bounds[0]), np.int32(j - bounds[2]), np.int32(bounds[1] - bounds[0]),
                    np.int32(bounds[3] - bounds[2]),
                )  # fmt: skip
                total = gather(
                    positions, before, np.int32(old + here), old, pitch, cell, p, b, multipliers, first, one, constants
                )
                valence = zero
                if averages:
                    valence = valence_of(Cell(row, column, rows, columns))
                weight = load_quad(state, np.int32(row * columns + column))[3]
                x, y, z = arrive(p, weight, total, valence)
                store_quad(positions, np.int32(quads - old) + here, x, y, z, p[3])

        return move

    def all_from(slot: int) -> Any:
        move = make_move(slot)
        if slot == each - 1:
            return move
        rest = all_from(slot + 1)

        @inline
        def both(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns):
            move(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns)
            rest(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns)

        return both

    move_all = all_from(0)

    @inline
    def sweep(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns):
        move_all(positions, old, before, multipliers, constants, bounds, state, origin, rows, columns)
        cuda.syncthreads()
        return np.int32(quads - old)

    return sweep
