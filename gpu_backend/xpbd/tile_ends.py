"""Transfers of a tile's masses and multipliers to and from a block, as routines.

A thread processes the same masses of the tile throughout. A block only writes the masses that it owns; it also reads
the halo.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import predict, settle
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.world import Cell
from softlab.gpu_backend.position_based.gather import valence_of, weight_of
from softlab.gpu_backend.position_based.point import accelerate, tether_mass
from softlab.gpu_backend.xpbd.sweep import chained, colour_variants, constraint_place, mass_place
from softlab.gpu_backend.xpbd.tile import SheetTile
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.position_based.plan import JACOBI


@inlined_routine
def mass(slot, origin, rows, columns):
    """Return (true if it is on the sheet, its index in the tile, its number, i, j) in the sheet, of number `slot` of a
    thread's masses; `origin`: position of the tile's first mass in the sheet."""
    item = np.int32(cuda.threadIdx.x + slot * np.int32(FEATURE.tile_threads))
    i, j = mass_place(item)
    row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
    exists = item < np.int32(FEATURE.tile_rows * FEATURE.tile_columns)
    exists = exists and row >= 0 and row < rows and column >= 0 and column < columns
    return exists, np.int32(i * np.int32(FEATURE.tile_pitch) + j), np.int32(row * columns + column), row, column


@inlined_routine
def is_inside(i, j):
    """Return True if the block owns the mass at (i, j) of the tile."""
    first_row, first_column = np.int32(FEATURE.halo_rows), np.int32(FEATURE.halo_columns)
    end_row = np.int32(FEATURE.halo_rows + FEATURE.owned_rows)
    end_column = np.int32(FEATURE.halo_columns + FEATURE.owned_columns)
    return i >= first_row and i < end_row and j >= first_column and j < end_column


@inlined_routine
def owned(slot, origin, rows, columns):
    """Return (true if the block owns it, its index in the tile, its number) of a thread's mass."""
    exists, here, k, row, column = mass(slot, origin, rows, columns)
    inside = is_inside(np.int32(row - origin[0]), np.int32(column - origin[1]))
    return exists and inside, here, k


class Tethers(NamedTuple):
    """Long-range attachments: positions at the substep's start, with weights; anchors and maximum distances [m] of each
    mass, flat; their number per mass."""

    state: np.ndarray
    anchors: np.ndarray
    reaches: np.ndarray
    count: int


@inlined_routine
def open_substep(position, velocity, shared, before, origin, world, step, air, rows, columns):
    """Predict positions from the state, into shared memory."""
    parameters = world.parameters
    for slot in range(FEATURE.masses_each):
        exists, here, k, i, j = mass(slot, origin, rows, columns)
        if exists:
            p, v = load_quad(position, k), load_quad(velocity, k)
            ax, ay, az = accelerate(
                position, velocity, k, Cell(i, j, rows, columns), p, v, parameters, world.integers, step, air
            )
            x, y, z = predict(p, v, ax, ay, az, parameters)
            spare = p[3]
            if FEATURE.jacobi or FEATURE.averaged_jacobi:
                spare = weight_of(valence_of(Cell(i, j, rows, columns)), spare)
            store_quad(shared, here, x, y, z, spare)
            if FEATURE.damped:
                store_quad(before, here, p[0], p[1], p[2], p[3])
    cuda.syncthreads()


@inlined_routine
def load(source, state, shared, before, origin, rows, columns):
    """Read the results of the previous launch into shared memory."""
    for slot in range(FEATURE.masses_each):
        exists, here, k, _, _ = mass(slot, origin, rows, columns)
        if exists:
            p = load_quad(source, k)
            store_quad(shared, here, p[0], p[1], p[2], p[3])
            if FEATURE.damped:
                b = load_quad(state, k)
                store_quad(before, here, b[0], b[1], b[2], b[3])
    cuda.syncthreads()


@inlined_routine
def attach(shared, old, tethers, origin, rows, columns):
    """Apply the long-range attachments; `tethers`: a Tethers."""
    if FEATURE.attachments:
        state, anchors, reaches, count = tethers
        for slot in range(FEATURE.masses_each):
            exists, here, k, _, _ = mass(slot, origin, rows, columns)
            if exists:
                p = load_quad(shared, old + here)
                weight = load_quad(state, k)[3]
                x, y, z = tether_mass(p, weight, state, anchors, reaches, np.int64(k) * count, count)
                store_quad(shared, old + here, x, y, z, p[3])
        cuda.syncthreads()


@inlined_routine
def store(shared, old, target, origin, rows, columns):
    """Write owned masses for the next launch."""
    for slot in range(FEATURE.masses_each):
        is_owned, here, k = owned(slot, origin, rows, columns)
        if is_owned:
            p = load_quad(shared, old + here)
            store_quad(target, k, p[0], p[1], p[2], p[3])


@inlined_routine
def close_substep(shared, old, state, target, velocity, origin, world, number, rows, columns):
    """Write velocities and positions after the colliders of owned masses into the new state."""
    for slot in range(FEATURE.masses_each):
        is_owned, here, k = owned(slot, origin, rows, columns)
        if is_owned:
            b = load_quad(state, k)
            px, py, pz, vx, vy, vz = settle(b, load_quad(shared, old + here), world, number)
            store_quad(target, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, 0.0)


@inlined_routine
def multiplier_place(slot, origin, rows, columns):
    """Return (true if it is in sheet and tile, true if the block owns it, its number in the planes) of a thread's
    constraint of a colour. It belongs to its first mass, which on a rising diagonal is to the right of (i, j)."""
    down, along = np.int32(FEATURE.rows_down), np.int32(FEATURE.columns_along)
    exists, i, j = constraint_place(slot)
    row, column = np.int32(origin[0] + i), np.int32(origin[1] + j)
    exists = exists and row >= 0 and column >= 0 and row + down < rows and column + along < columns
    exists = exists and i + down < np.int32(FEATURE.tile_rows) and j + along < np.int32(FEATURE.tile_columns)
    lead = np.int32(FEATURE.rising)
    first_row, first_column = np.int32(FEATURE.halo_rows), np.int32(FEATURE.halo_columns)
    end_row = np.int32(FEATURE.halo_rows + FEATURE.owned_rows)
    end_column = np.int32(FEATURE.halo_columns + FEATURE.owned_columns)
    inside = i >= first_row and i < end_row and j + lead >= first_column and j + lead < end_column
    plane = np.int64(FEATURE.multiplier_plane)
    return exists, exists and inside, plane * rows * columns + np.int32(row * columns + column)


@inlined_routine
def fetch_colour(multipliers, planes, origin, rows, columns):
    """Read a thread's multipliers of a colour from the planes of the previous launch, including the halo."""
    first = FEATURE.first_multiplier
    for slot in range(FEATURE.slots):
        exists, _, place = multiplier_place(slot, origin, rows, columns)
        if exists:
            multipliers[first + slot] = planes[place]


@inlined_routine
def leave_colour(multipliers, planes, origin, rows, columns):
    """Write a thread's multipliers of owned constraints of a colour into the planes."""
    first = FEATURE.first_multiplier
    for slot in range(FEATURE.slots):
        _, is_owned, place = multiplier_place(slot, origin, rows, columns)
        if is_owned:
            planes[place] = multipliers[first + slot]


@inlined_routine
def fetch_masses(multipliers, planes, origin, rows, columns):
    """Read the multipliers of a thread's masses from the planes of the previous launch, including the halo."""
    count = FEATURE.multipliers
    for slot in range(FEATURE.masses_each):
        exists, _, k, _, _ = mass(slot, origin, rows, columns)
        if exists:
            for n in range(FEATURE.multipliers):
                multipliers[slot * count + n] = planes[np.int64(n) * rows * columns + k]


@inlined_routine
def leave_masses(multipliers, planes, origin, rows, columns):
    """Write the multipliers of a thread's owned masses into the planes."""
    count = FEATURE.multipliers
    for slot in range(FEATURE.masses_each):
        is_owned, _, k = owned(slot, origin, rows, columns)
        if is_owned:
            for n in range(FEATURE.multipliers):
                planes[np.int64(n) * rows * columns + k] = multipliers[slot * count + n]


@cache
def multiplier_moves(real: Real, math: str, parts: frozenset[str], axes: int, tile: SheetTile) -> dict[str, Any]:
    """Return `fetch` and `leave`, (multipliers, planes, origin, rows, columns), of all of a thread's multipliers."""
    if parts & JACOBI:
        return {"fetch": fetch_masses, "leave": leave_masses}
    soft = [variant for is_soft, variant in colour_variants(real, math, parts, axes, tile) if is_soft]
    return {
        "fetch": chained([variant(fetch_colour) for variant in soft]),
        "leave": chained([variant(leave_colour) for variant in soft]),
    }
