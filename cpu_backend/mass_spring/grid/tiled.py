"""The kernel `tiled`: several passes for one transfer through memory, for grids that fit into no cache.

A band of rows is divided into tiles of columns. A tile's walk goes down the rows with `levels` passes in flight: level
k is one row behind level k - 1, whose last two rows it reads from a small ring; level 1 reads the state, the last level
writes the other state. So a row is read once and written once for all levels, and intermediate rows stay in the
second-level cache. Nothing is exchanged: a band or tile also computes the values that it needs of its neighbours. In
rows this is exact; in columns it is a halo of whole blocks on both sides, whose outer columns become invalid by one
column per level and are never used.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, L_COLUMNS, L_PLANE, L_ROWS, L_STRIDE, PLANES, block_of, row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.mass_spring.grid.kernels import ABOVE_ROWS
from softlab.cpu_backend.mass_spring.grid.row_step import pass_kind, step_row
from softlab.cpu_backend.mass_spring.grid.rows import SUM_ROWS, begin_walk, grid_kernel, variant_name
from softlab.model.base.types import Real
from softlab.model.base.variant import routine

RING = 2 * PLANES  # rows of a level's ring: two, of four planes
LEVEL_ROWS = RING + ABOVE_ROWS


def halo(levels: int, real: Real) -> int:
    """Return the extra columns on each side of a tile: whole blocks, at least one column for each level but the
    last."""
    block = block_of(real)
    return -(-max(levels - 1, 1) // block) * block


def tile_buffer(levels: int, tile: int, real: Real) -> tuple[int, int]:
    """Return (width, size): scalars of a row of a tile's buffer, and of the whole buffer, a band's scratch.

    A block before the rows and one after them is never computed, but may be read.
    """
    width = tile + 2 * halo(levels, real) + block_of(real)
    return width, (levels * LEVEL_ROWS + SUM_ROWS) * width + 2 * block_of(real)


@routine
def walk_tile(first, last, start, tiling, buffer, first_pass, passes, source, target, sheet):
    """Do the tiling's passes from `first_pass` on of rows `first` to before `last`, columns `start` to before
    `start + tile`."""
    tile, halo, width, layout = tiling.tile, tiling.halo, tiling.width, sheet.layout
    levels = min(tiling.levels, passes.number - first_pass)
    rows, columns, stride, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_STRIDE], layout[L_PLANE]
    left = max(start - halo, 0)
    all_blocks = (min(start + tile + halo, columns) - left + BLOCK - 1) // BLOCK
    last_blocks = (min(start + tile, columns) - start + BLOCK - 1) // BLOCK
    sums = row_at(buffer, levels * LEVEL_ROWS * width + BLOCK)
    for front in range(max(first - levels, 0), last + levels - 1):  # the row of level 1
        for level in range(1, levels + 1):
            i, more = front - (level - 1), levels - level
            top, bottom = max(first - more, 0), min(last + more, rows)
            if i < top - 1 or i < 0 or i >= bottom:
                continue
            column, blocks = left, all_blocks
            if level == levels:
                column, blocks = start, last_blocks
            ring = (level - 1) * LEVEL_ROWS * width + BLOCK  # of the level before
            above = row_at(buffer, ring + RING * width)
            if level == 1:
                level_source, source_plane = source, plane
                here, below = i * stride + column, (i + 1) * stride + column
            else:
                level_source, source_plane = buffer, width
                here = ring + (i % 2) * PLANES * width + column - left
                below = ring + ((i + 1) % 2) * PLANES * width + column - left
            if i < top:  # only the pull of this row on the next is needed
                begin_walk(
                    i + 1, blocks, level_source, below, below - here, source_plane, sheet.parameters, above, width
                )
                continue
            if i == 0:
                begin_walk(i, blocks, level_source, here, below - here, source_plane, sheet.parameters, above, width)
            if i == rows - 1:
                below = here
            if level == levels:
                level_target, there, target_plane = target, i * stride + column, plane
            else:
                level_target, target_plane = buffer, width
                there = ring + LEVEL_ROWS * width + (i % 2) * PLANES * width
            k = first_pass + level - 1
            step_row(
                pass_kind(k, passes), passes.step + k, i, column, blocks, level_source, here, below,
                source_plane, level_target, there, target_plane, above, sums, width, sheet,
            )  # fmt: skip


@routine
def walk_band(band, tiling, scratches, first_pass, passes, states, current, sheet):
    layout = sheet.layout
    rows, columns, plane = layout[L_ROWS], layout[L_COLUMNS], layout[L_PLANE]
    bands = np.int64(scratches.shape[0])
    first, last = rows * band // bands, rows * (band + 1) // bands
    source, target = row_at(states, current * PLANES * plane), row_at(states, (1 - current) * PLANES * plane)
    for start in range(0, columns, tiling.tile):
        walk_tile(
            first, last, np.int64(start), tiling, scratches[band], first_pass, passes, source, target, sheet
        )  # fmt: skip


@routine
def advance(team, member, bands, passes, states, current, sheet, scratches, tiling):
    for turn in range((passes.number + tiling.levels - 1) // tiling.levels):
        first_pass, now = turn * tiling.levels, (current + turn) % 2
        for band in assigned(team, member, bands):
            walk_band(np.int64(band), tiling, scratches, first_pass, passes, states, now, sheet)


@cache
def make_tiled_advance(real: Real, math: str, integrator: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, passes, states, current, sheet, scratches, tiling).

    As the kernel `fused` (mass_spring/grid/kernels.py), but the states are swapped only once per `levels` passes.
    `tiling`: Tiling of choice.py.
    """
    compiler = Compiler(variant_name("tiled", real, math, integrator, parts), math)
    return compiler.team(grid_kernel(compiler, advance, real, integrator, parts))
