"""An iteration over all constraints of a tile in a block's shared memory, as routines.

A thread processes the same constraints in every iteration, so their multipliers stay in its registers: an array of
numbers whose loops the compiler unrolls (tests/kernels/ptx_rows.py: nothing is left in local memory).
After each colour the block's threads synchronise; no colour is a launch.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.position_based.constraints import KINDS, compliant, dampers, family_features, pair
from softlab.gpu_backend.position_based.gather import ONE, TWO, arrive, displacement, displacement_of, valence_of
from softlab.gpu_backend.position_based.kernels import compact_shape
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, Variant, filled, inlined_routine
from softlab.model.position_based.plan import JACOBI, Family, colour_order, families

head = Open("head(a, b, c, d, e)")
rest = Open("rest(a, b, c, d, e)")
move_masses = Open("move_masses(positions, old, before, multipliers, place): `move_mass` of each of a thread's masses")


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


def tile_features(parts: frozenset[str], axes: int, tile: SheetTile) -> dict[str, Any]:
    """Return the features of a scene's kernels on a tile."""
    return particle_features(parts, axes) | {
        "tile_rows": tile.rows.size, "tile_columns": tile.columns.size, "tile_pitch": tile.pitch,
        "tile_quads": tile.quads, "tile_threads": tile.threads, "masses_each": masses_each(tile),
        "owned_rows": tile.rows.owned, "owned_columns": tile.columns.owned, "halo_rows": tile.rows.before,
        "halo_columns": tile.columns.before, "registers": register_multipliers(parts, tile),
    }  # fmt: skip


@cache
def colour_variants(
    real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile
) -> list[tuple[bool, Variant]]:
    """Return (true if its constraints have multipliers, the variant of its routines) of each colour, in order."""
    variants, slot, of_tile = [], 0, tile_features(parts, axes, tile)
    soft = [family for family in families(parts) if compliant(parts, family)]
    for family, colour in colour_order(parts):
        rows, columns = compact_shape(family, tile.rows.size, tile.columns.size)
        stride, phase = (family.rows, tile.rows.phase) if family.rows else (family.columns, tile.columns.phase)
        features = of_tile | family_features(parts, family, colour, axes) | {
            "lattice_rows": rows, "lattice_columns": columns, "lattice_shift": stride * ((colour - phase // stride) % 2),
            "slots": colour_slots(tile, family), "first_multiplier": slot,
            "multiplier_plane": soft.index(family) if family in soft else 0,
        }  # fmt: skip
        variants.append((family in soft, device_variant(real, math, features)))
        slot += colour_slots(tile, family) * (family in soft)
    return variants


@inlined_routine
def mass_place(item):
    """Return (i, j) of mass number `item` of a tile, along rows."""
    number, columns = np.uint32(item), np.uint32(FEATURE.tile_columns)
    return np.int32(number // columns), np.int32(number % columns)


@inlined_routine
def lattice_place(item):
    """Return (i, j) of constraint number `item` of a colour's lattice, along rows, or down columns so that the threads
    of a warp are below one another: with an odd pitch neither direction has bank conflicts."""
    number = np.uint32(item)
    if FEATURE.rows_down > 0:
        columns = np.uint32(FEATURE.lattice_columns)
        return np.int32(number // columns), np.int32(number % columns)
    rows = np.uint32(FEATURE.lattice_rows)
    return np.int32(number % rows), np.int32(number // rows)


@inlined_routine
def constraint_place(slot):
    """Return (true if it exists, i, j) of a thread's constraint of a colour, within the tile."""
    item = np.int32(cuda.threadIdx.x + slot * np.int32(FEATURE.tile_threads))
    i, j = lattice_place(item)
    shift = np.int32(FEATURE.lattice_shift)
    if FEATURE.rows_down > 0:
        i = np.int32(TWO * i - i % np.int32(FEATURE.rows_down) + shift)
    else:
        j = np.int32(TWO * j - j % np.int32(FEATURE.columns_along) + shift)
    return item < np.int32(FEATURE.lattice_rows * FEATURE.lattice_columns), i, j


@inlined_routine
def sweep_colour(positions, before, multipliers, constants, bounds):
    """Project the constraints of one colour, with a barrier at the end.

    `bounds`: (first row, end, first column, end) of the tile's masses that are on the sheet.
    """
    down, along, pitch = np.int32(FEATURE.rows_down), np.int32(FEATURE.columns_along), np.int32(FEATURE.tile_pitch)
    first_multiplier = FEATURE.first_multiplier
    for slot in range(FEATURE.slots):
        exists, i, j = constraint_place(slot)
        if exists and i >= bounds[0] and i + down < bounds[1] and j >= bounds[2] and j + along < bounds[3]:
            place = np.int32(i * pitch + j)
            first, second = place, np.int32(place + down * pitch + along)
            if FEATURE.rising:
                first, second = np.int32(place + along), np.int32(place + down * pitch)
            multiplier = 0.0
            if FEATURE.soft:
                multiplier = multipliers[first_multiplier + slot]
            multiplier = pair(positions, before, first, second, multiplier, constants)
            if FEATURE.soft:
                multipliers[first_multiplier + slot] = multiplier
    cuda.syncthreads()


@inlined_routine
def both(a, b, c, d, e):
    head(a, b, c, d, e)
    rest(a, b, c, d, e)


@inlined_routine
def nothing(a, b, c, d, e):
    pass


def chained(routines: Sequence[Any]) -> Any:
    """Return a routine that calls all of them, in order, with its five arguments."""
    return filled(both, {"head": routines[0], "rest": chained(routines[1:])}) if routines else nothing


@inlined_routine
def move_mass(positions, old, before, multipliers, place):
    """Move one of a thread's masses by its constraints.

    Each is compiled separately: in a loop, which the compiler does not unroll around so much code, multipliers would be
    in local memory.
    """
    constants, bounds, state, origin, size = place
    rows, columns = size
    pitch = np.int32(FEATURE.tile_pitch)
    item = np.int32(cuda.threadIdx.x + np.int32(FEATURE.slot * FEATURE.tile_threads))
    i, j = mass_place(item)
    masses = np.int32(FEATURE.tile_rows * FEATURE.tile_columns)
    if item < masses and i >= bounds[0] and i < bounds[1] and j >= bounds[2] and j < bounds[3]:
        here = np.int32(i * pitch + j)
        row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
        p, b = load_quad(positions, old + here), load_quad(before, here)
        cell = Cell(
            np.int32(i - bounds[0]), np.int32(j - bounds[2]), np.int32(bounds[1] - bounds[0]),
            np.int32(bounds[3] - bounds[2]),
        )  # fmt: skip
        pulling = positions, before, old, p, b, multipliers, np.int32(FEATURE.first_multiplier), ONE, constants
        total = displacement(np.int32(old + here), pitch, cell, pulling)
        valence = 0.0
        if FEATURE.averaged_jacobi:
            valence = valence_of(Cell(row, column, rows, columns))
        weight = load_quad(state, np.int32(row * columns + column))[3]
        x, y, z = arrive(p, weight, total, valence)
        store_quad(positions, np.int32(np.int32(FEATURE.tile_quads) - old) + here, x, y, z, p[3])


@inlined_routine
def sweep_masses(positions, old, before, multipliers, place):
    """Do one Jacobi iteration, from the copy that begins at quad `old` into the other one. Return the start of the new
    positions.

    `place`: (constants, bounds, state, origin, (rows, columns)). Weights are those of `state`, in device memory;
    `origin` is the tile's position (i, j) in the sheet. The tile treats its edge as the sheet's: the resulting errors
    stay in the halo.
    """
    move_masses(positions, old, before, multipliers, place)
    cuda.syncthreads()
    return np.int32(np.int32(FEATURE.tile_quads) - old)


@cache
def sweeps(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> dict[str, Any]:
    """Return `sweep_colours`, all colours of Gauss-Seidel, and `sweep_masses` of a scene, by name."""
    if not parts & JACOBI:
        colours = colour_variants(real, math, parts, axes, tile)
        return {"sweep_colours": chained([variant(sweep_colour) for _, variant in colours])}
    move, slots = filled(move_mass, {"displacement": displacement_of(real, math, parts, axes)}), masses_each(tile)
    features, each = tile_features(parts, axes, tile), register_multipliers(parts, tile) // slots
    variants = [
        device_variant(real, math, features | {"slot": slot, "first_multiplier": slot * each}) for slot in range(slots)
    ]
    moves = chained([variant(move) for variant in variants])
    return {"sweep_masses": filled(sweep_masses, {"move_masses": moves})}
