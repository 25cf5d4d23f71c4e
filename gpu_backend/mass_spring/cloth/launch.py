"""Launches of the cloth's kernel `resident`: its grid of blocks, its shared memory, and the buffers of its messages."""

from __future__ import annotations

from math import prod

import numpy as np

from softlab.gpu_backend.core.device import Arguments, device_limits
from softlab.gpu_backend.core.launch import prepare
from softlab.gpu_backend.core.messages import message_size
from softlab.gpu_backend.core.tiling import Tile, tile_count, why_no_block, why_not_at_once
from softlab.gpu_backend.mass_spring.cloth.resident import make_cloth_resident
from softlab.gpu_backend.mass_spring.cloth.tiles import cloth_blocks_together
from softlab.gpu_backend.mass_spring.cloth.tiling import fields, most_to_fetch, overlap_of, tile_bytes
from softlab.gpu_backend.mass_spring.passes import QuadPasses, TileLaunches
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real

MAX_EACH = 31  # masses that a thread fetches: bits of an integer


def cloth_blocks(rows: int, columns: int, tile: Tile, parts: frozenset[str]) -> tuple[int, int]:
    """Return (across, down): the tiles over a sheet."""
    overlap = overlap_of(tile, parts)
    return tile_count(columns, tile.columns, overlap), tile_count(rows, tile.rows, overlap)


def why_no_cloth_tile(
    rows: int, columns: int, real: Real, tile: Tile, parts: frozenset[str], limits: tuple[int, int] | None = None
) -> str:
    """Return the reason why `resident` cannot run a sheet on this tile on this GPU, or on one of `limits` (see
    `device_limits`), or ""."""
    processors, most_shared = limits or device_limits()
    overlap = overlap_of(tile, parts)
    if tile.halo < 1:
        return f"a tile of {tile.name} needs at least one step between exchanges: h1"
    if reason := why_no_block(tile, tile_bytes(real, tile, parts), most_shared):
        return reason
    if tile.rows > rows or tile.columns > columns:
        return f"a tile of {tile.name} is {tile.rows} x {tile.columns}, larger than the sheet of {rows} x {columns}"
    if (tile.rows < rows and tile.rows <= 2 * overlap) or (tile.columns < columns and tile.columns <= 2 * overlap):
        return f"a tile of {tile.name} is too small for {tile.halo} steps"
    if most_to_fetch(tile, parts) > MAX_EACH * tile.threads:
        return f"a tile of {tile.name} has too few threads to read its neighbourhood"
    together = processors * cloth_blocks_together(real, tile, parts)
    return why_not_at_once(rows, columns, tile, prod(cloth_blocks(rows, columns, tile, parts)), together)


class ClothTiles(TileLaunches):
    """The launches of `resident`, for gpu_backend/mass_spring/cloth/solver.py."""

    simulation: QuadPasses

    def __init__(self, simulation: QuadPasses, kernel: str, tile: Tile):
        super().__init__(simulation, kernel, tile)
        real, parts = simulation.real, simulation.plan.parts
        rows, columns = simulation.body.rows, simulation.body.columns
        reason = why_no_cloth_tile(rows, columns, real, tile, parts)
        if reason:
            raise SceneError("--kernel", kernel, f"{reason}; use graph")
        variant = real, simulation.options.math, simulation.scene.method.integrator, parts, tile
        shared = tile_bytes(real, tile, parts)
        self._grid = (cloth_blocks(rows, columns, tile, parts), tile.threads, simulation.stream, shared)
        self._kernel = make_cloth_resident(*variant)
        count = 2 * simulation.particle_count * message_size(real)
        sizes = count, count if fields(tile, parts) == 6 else 1
        self._borders = [simulation.zeros(size, real) for size in sizes]
        prepare(self._kernel, self._arguments(0, 1), shared, cooperative=True)

    def _arguments(self, number: int, passes: int) -> Arguments:
        s = self.simulation
        constants = (s.record, s.bodies, s.integers, s._counter)
        border: Arguments = (*self._borders, np.int32(self._epoch), self._failed)
        return (*s.states(), *border, *constants, np.int64(passes), *s.shape)
