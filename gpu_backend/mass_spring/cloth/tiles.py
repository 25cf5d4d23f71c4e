"""Tiles of a cloth, for the kernel `resident`: places of a thread's strip, reading, stepping and
writing (the partition: mass_spring/cloth/tiling.py; the steps: mass_spring/cloth/strips.py)."""

from __future__ import annotations

from math import prod

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.planes import near
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.core.tiling import Tile, blocks_together
from softlab.gpu_backend.core.wind import air_now
from softlab.gpu_backend.mass_spring.cloth.strips import put
from softlab.gpu_backend.mass_spring.cloth.tiling import (
    fields,
    most_to_fetch,
    needs_velocities,
    plane_shape,
    stencil_rows,
    tile_bytes,
)
from softlab.gpu_backend.mass_spring.tile_bits import bits_between, tile_features
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine


def cloth_blocks_together(real: Real, tile: Tile, parts: frozenset[str]) -> int:
    """Return the number of blocks that should fit on a multiprocessor, with 128 registers a thread (in float64 all that
    a thread can have)."""
    return blocks_together(tile, tile_bytes(real, tile, parts), 128 if real is np.float32 else 256)


def cloth_tile_features(tile: Tile, parts: frozenset[str]) -> dict[str, int]:
    """Return the features of a cloth's kernel on a tile."""
    return {
        **tile_features(tile), "area": prod(plane_shape(tile, parts)), "pitch": plane_shape(tile, parts)[1],
        "fetched": -(-most_to_fetch(tile, parts) // tile.threads), "fields": fields(tile, parts),
        "neighbour_velocities": needs_velocities(parts), "stencil": stencil_rows(parts), "threads": tile.threads,
    }  # fmt: skip


@inlined_routine
def span(index, count, masses, size):
    """Return tiling.span in the kernel's integers."""
    overlap = np.int32(FEATURE.stencil * (FEATURE.halo - 1))
    inner = np.int64(masses - np.int32(2) * overlap)
    first, end = np.int32(0), np.int32(masses)
    if index > 0:
        first = np.int32(overlap + np.int32(np.int64(index) * inner // count))
    if index < count - 1:
        end = np.int32(overlap + np.int32(np.int64(index + 1) * inner // count))
    return np.int32(min(max(np.int32(first - overlap), np.int32(0)), np.int32(masses - size))), first, end


@inlined_routine
def place_of(rows, columns):
    """Return (row, column and number of the first mass of the thread's strip, its index in the planes, extent).

    extent: first row of the tile, first and end of the rows that the block owns, and the same of its columns.
    """
    width, height, stencil = np.int32(FEATURE.tile_columns), np.int32(FEATURE.tile_rows), np.int32(FEATURE.stencil)
    row_start, row_first, row_end = span(np.int32(cuda.blockIdx.y), np.int32(cuda.gridDim.y), rows, height)
    column_start, column_first, column_end = span(np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x), columns, width)
    thread = np.int32(cuda.threadIdx.x)
    down, across = np.int32(thread // width * FEATURE.strip), np.int32(thread % width)
    i, j = np.int32(row_start + down), np.int32(column_start + across)
    k, place = (
        np.int32(i * columns + j), np.int32((down + stencil) * np.int32(FEATURE.pitch) + (across + stencil))
    )  # fmt: skip
    return i, j, k, place, (row_start, row_first, row_end, column_start, column_first, column_end)


@inlined_routine
def around(number, extent, rows, columns):
    """Return (number of the mass in the sheet, its index in the planes) of mass `number` of those within `rings` of
    the masses that the block owns, counted from above; -1 for none."""
    rings = np.int32(FEATURE.stencil * FEATURE.halo)
    row_start, row_first, row_end, column_start, column_first, column_end = extent
    top, bottom = np.int32(max(row_first - rings, 0)), np.int32(min(row_end + rings, rows))
    west, east = np.int32(max(column_first - rings, 0)), np.int32(min(column_end + rings, columns))
    across, above, below = np.int32(east - west), np.int32(row_first - top), np.int32(bottom - row_end)
    beside = np.int32(across - (column_end - column_first))
    ends = np.int32((above + below) * across)
    i, j = np.int32(-1), np.int32(0)
    if number < ends:
        i, j = np.int32(top + number // across), np.int32(west + number % across)
        if i >= row_first:
            i = np.int32(i + (row_end - row_first))
    elif beside > 0:
        number = np.int32(number - ends)
        if number < beside * (row_end - row_first):
            i, j = np.int32(row_first + number // beside), np.int32(west + number % beside)
            if j >= column_first:
                j = np.int32(j + (column_end - column_first))
    if i < 0:
        return np.int32(-1), np.int32(0)
    stencil, pitch = np.int32(FEATURE.stencil), np.int32(FEATURE.pitch)
    place = np.int32((i - row_start + stencil) * pitch + (j - column_start + stencil))
    return np.int32(i * columns + j), place


@inlined_routine
def border_bits(owned_rows, i, j, extent, rows, columns):
    """Return those of the bits `owned_rows` that other blocks need."""
    rings = np.int32(FEATURE.stencil * FEATURE.halo)
    _, row_first, row_end, _, column_first, column_end = extent
    inner_first, inner_end = row_first, row_end
    if row_first > 0:
        inner_first = np.int32(row_first + rings)
    if row_end < rows:
        inner_end = np.int32(row_end - rings)
    border = owned_rows & ~bits_between(inner_first, inner_end, i)
    if (column_first > 0 and j < column_first + rings) or (column_end < columns and j >= column_end - rings):
        border = owned_rows
    return np.int32(border)


@inlined_routine
def clear(shared, thread):
    """Zero shared memory, as masses beyond the sheet must be finite."""
    airs = np.int32(2 * FEATURE.fields * FEATURE.area)
    for place in range(thread, airs, np.int32(FEATURE.threads)):
        shared[place] = 0.0


@inlined_routine
def read(position, velocity, shared, place, velocities, k, columns):
    """Read a thread's own masses; returns the bits of those that are pinned."""
    pin_bits, (vx, vy, vz) = np.int32(0), velocities
    for r in range(FEATURE.strip):
        here = np.int32(k + np.int32(r) * columns)
        p, v = load_quad(position, here), load_quad(velocity, here)
        vx[r], vy[r], vz[r] = v[0], v[1], v[2]
        put(shared, np.int32(place + np.int32(r) * np.int32(FEATURE.pitch)), p[0], p[1], p[2], v[0], v[1], v[2])
        if FEATURE.pins:
            if p[3] != 0.0:
                pin_bits = pin_bits | np.int32(1 << r)
    return pin_bits


@inlined_routine
def read_other(position, velocity, shared, number, place):
    """Read mass `number` of the sheet, which another thread or block computes."""
    p, v = load_quad(position, number), load_quad(velocity, number)
    put(shared, place, p[0], p[1], p[2], v[0], v[1], v[2])


@inlined_routine
def write(position, new_position, new_velocity, owned_rows, shared, place, velocities, k, columns):
    vx, vy, vz = velocities
    for r in range(FEATURE.strip):
        if owned_rows & np.int32(1 << r):
            here, at = np.int32(k + np.int32(r) * columns), np.int32(place + np.int32(r) * np.int32(FEATURE.pitch))
            x, y, z = near(shared, at, 0), near(shared, at, FEATURE.area), near(shared, at, 2 * FEATURE.area)
            store_quad(new_position, here, x, y, z, load_quad(position, here)[3])
            store_quad(new_velocity, here, vx[r], vy[r], vz[r], 0.0)


@inlined_routine
def first_air(parameters, integers, step, shared, thread):
    """Compute the air of the first step, if it gusts: for all threads after the next barrier."""
    airs = np.int32(2 * FEATURE.fields * FEATURE.area)
    if FEATURE.gust:
        if thread == 0:
            x, y, z = air_now(parameters, integers, step, 0.0)
            shared[airs], shared[airs + 1], shared[airs + 2] = x, y, z


@inlined_routine
def air_of(parameters, integers, step, shared, thread, number):
    """Return the air of a step; with gusts its first thread computes the next one's."""
    airs = np.int32(2 * FEATURE.fields * FEATURE.area)
    if FEATURE.gust:
        now = np.int32(airs + 4 * np.int32(number & 1))
        later = np.int32(airs + 4 * np.int32(1 - (number & 1)))
        x, y, z = shared[now], shared[now + 1], shared[now + 2]
        if thread == 0:
            ax, ay, az = air_now(parameters, integers, step + np.int64(1), 0.0)
            shared[later], shared[later + 1], shared[later + 2] = ax, ay, az
        return x, y, z
    if FEATURE.wind:
        return air_now(parameters, integers, step, 0.0)
    return 0.0, 0.0, 0.0
