"""Partition of a cloth into tiles: pure arithmetic, for the kernels, their launches and their tests.

A tile's `columns` x `rows` masses are computed by one block, and are all on the sheet; around them are as many rings as
springs and triangles reach, which are only read. In a round of `halo` steps the first one computes all of the tile, and
each later one `reach` rings less: the block owns what is left after the last. So tiles overlap by `overlap` = reach
(halo - 1) rings on each side, none if `halo` is 1, and a block needs reach * halo rings around its own masses from
others at the end of a round.
"""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.tiling import Tile
from softlab.model.base.types import Real

AIRS = 8  # scalars: the air's velocity of this step and of the next


def stencil_rows(parts: frozenset[str]) -> int:
    """Return the rings of masses that the forces on a mass depend on."""
    return 2 if "bending" in parts else 1


def overlap_of(tile: Tile, parts: frozenset[str]) -> int:
    """Return the rings that a tile shares with each neighbour's."""
    return stencil_rows(parts) * (tile.halo - 1)


def needs_velocities(parts: frozenset[str]) -> bool:
    """Return True if a force depends on neighbours' velocities."""
    return bool(parts & {"wind", "structural-damping", "shear-damping", "bending-damping"})


def plane_shape(tile: Tile, parts: frozenset[str]) -> tuple[int, int]:
    """Return (rows, columns) of a block's plane of a scalar: its tile and the rings around it."""
    return tile.rows + 2 * stencil_rows(parts), tile.columns + 2 * stencil_rows(parts)


def fields(tile: Tile, parts: frozenset[str]) -> int:
    """Return the scalars of a mass in shared memory, with velocities if neighbours need them or overlaps are
    updated."""
    return 6 if needs_velocities(parts) or tile.halo > 1 else 3


def tile_bytes(real: Real, tile: Tile, parts: frozenset[str]) -> int:
    """Return the shared memory of a block [bytes]: two copies of its planes, and the air's velocity."""
    rows, columns = plane_shape(tile, parts)
    return (2 * fields(tile, parts) * rows * columns + AIRS) * np.dtype(real).itemsize


def most_to_fetch(tile: Tile, parts: frozenset[str]) -> int:
    """Return the largest number of masses that a block needs from others after a round."""
    rings, overlap = stencil_rows(parts) * tile.halo, overlap_of(tile, parts)
    rows, columns = tile.rows - 2 * overlap, tile.columns - 2 * overlap
    return 2 * rings * (columns + 2 * rings + rows)


def span(index: int, count: int, masses: int, size: int, overlap: int) -> tuple[int, int, int]:
    """Return (first mass of tile `index` of `count`, first mass it owns, first mass after those it owns) along an axis.

    `count`: of tiling.tile_count. Owned masses are divided evenly; all tiles are on the sheet, so the last ones may
    contain more than they need.
    """
    inner = masses - 2 * overlap
    first = overlap + index * inner // count if index > 0 else 0
    end = overlap + (index + 1) * inner // count if index < count - 1 else masses
    return min(max(first - overlap, 0), masses - size), first, end
