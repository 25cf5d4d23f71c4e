"""Launches of the kernels on tiles: their grids of blocks, their shared memory, and the buffers of their borders."""

from __future__ import annotations

from math import prod

import numpy as np

from softlab.gpu_backend.core.device import Arguments, Stream, device_limits
from softlab.gpu_backend.core.launch import can_capture, prepare
from softlab.gpu_backend.core.tiling import Tile, owned, tile_count, whole_strips, why_no_block, why_not_at_once
from softlab.gpu_backend.mass_spring.bands import Bands, band_cuts
from softlab.gpu_backend.mass_spring.grid.resident import FLAG_STRIDE, make_resident
from softlab.gpu_backend.mass_spring.grid.strips import shared_bytes
from softlab.gpu_backend.mass_spring.grid.tiles import grid_blocks_together, make_tile_pass
from softlab.gpu_backend.mass_spring.passes import SheetPasses, TileLaunches
from softlab.model.base.errors import SceneError
from softlab.model.base.types import Real


def blocks_of(rows: int, columns: int, tile: Tile) -> tuple[int, int]:
    """Return (across, down): the tiles over a grid."""
    return tile_count(columns, tile.columns, tile.halo), tile_count(rows, tile.rows, tile.halo)


def why_no_tile(
    kernel: str, rows: int, columns: int, real: Real, tile: Tile, limits: tuple[int, int] | None = None
) -> str:
    """Return the reason why a kernel on tiles cannot run a grid with this tile on this GPU, or on one of `limits` (see
    `device_limits`), or ""."""
    processors, most_shared = limits or device_limits()
    several = rows > tile.rows or columns > tile.columns
    if reason := why_no_block(tile, shared_bytes(real, tile), most_shared):
        return reason
    if kernel == "one-block" and several:
        return f"a block of {tile.name} holds at most {tile.rows} x {tile.columns} masses"
    if several and (tile.halo < 1 or min(tile.rows, tile.columns) < 3 * tile.halo):
        return f"a tile of {tile.name} is too small for its halo"
    if kernel != "resident":
        return ""
    together = processors * grid_blocks_together(real, tile)
    return why_not_at_once(rows, columns, tile, prod(blocks_of(rows, columns, tile)), together)


class TileLauncher(TileLaunches):
    """The launches of `one-block`, `tiles` or `resident`, for gpu_backend/mass_spring/grid/solver.py."""

    def __init__(self, simulation: SheetPasses, kernel: str, tile: Tile):
        super().__init__(simulation, kernel, tile)
        rows, columns = simulation.body.rows, simulation.body.columns
        if reason := why_no_tile(kernel, rows, columns, simulation.real, tile):
            raise SceneError("--kernel", kernel, f"{reason}; use {'graph' if kernel == 'tiles' else 'tiles or graph'}")
        across, down = self.tiles = blocks_of(rows, columns, tile)
        self.together = device_limits()[0] * grid_blocks_together(simulation.real, tile)
        cut = rows % tile.strip != 0 if across * down == 1 else not whole_strips(rows, tile)
        variant = (
            simulation.real, simulation.options.math, simulation.scene.method.integrator, simulation.plan.parts, tile, cut
        )  # fmt: skip
        shared = shared_bytes(simulation.real, tile)
        self._grid = ((across, down), (tile.columns, tile.strips), simulation.stream, shared)
        if kernel == "resident":
            self._kernel = make_resident(*variant)
            count = 2 * simulation.particle_count
            pair = np.complex64 if simulation.real is np.float32 else np.complex128
            self._borders = [simulation.zeros(count, pair) for _ in range(2)]
            self._flags = simulation.zeros(across * down * FLAG_STRIDE, np.int32)
        else:
            self._kernel = make_tile_pass(*variant, kernel == "one-block")
        prepare(self._kernel, self._arguments(0, 1), shared, cooperative=kernel == "resident")
        self._bands = self.bands() if kernel == "tiles" and can_capture() else None

    def _arguments(self, number: int, passes: int, first: int = 0) -> Arguments:
        """Return the kernel's arguments; `first`: the row of tiles that a launch begins with."""
        s = self.simulation
        states, tail = s.states(), (np.int64(passes), s.pinned, *s.shape)
        if self.kernel == "resident":
            border: Arguments = (*self._borders, self._flags, np.int32(self._epoch), self._failed)
            return (*states, *border, s.record, s.integers, s._counter, *tail)
        place = np.int32(first), np.int32(self.tiles[1])
        return (*states, s.record, s.integers, s._counter, np.int64(number), *tail, *place)

    def bands(self, above: int = 0, below: int = 0) -> Bands | None:
        """Return the bands in which the kernel `tiles` goes over the grid, None if they would not pay: if all its
        blocks run at once, and there is nothing to wait for.

        `above`, `below`: number of rows of masses at cut edges that are read or written between passes: separate bands
        (0: no such edge).
        """
        (across, down), tile = self.tiles, self.tile
        if not above and not below and across * down <= self.together:
            return None
        touched = [
            sum(_owns(tile, k, down, self.simulation.body.rows, rows, end) for k in range(down)) if rows else 0
            for rows, end in ((above, 0), (below, 1))
        ]
        cuts = band_cuts(down, max(1, self.together // (3 * across)), *touched)
        return Bands(self.simulation.stream, cuts, above > 0, below > 0) if len(cuts) > 2 else None

    def launch_captured(self, parity: int, count: int) -> None:
        """Launch as `launch_many`, for a stream that is captured: in bands, if there are several."""
        if self._bands is None:
            self.launch_many(parity, count)
            return
        self.simulation._current = parity
        self._bands.fork()
        for number in range(count):
            self.launch_in(self._bands, number * self.tile.halo, self.tile.halo)
        self._bands.join()

    def close(self) -> None:
        if self._bands is not None:
            self._bands.close()

    def parts_of(self, steps: int) -> list[int]:
        """Return the passes of each launch of the kernel `tiles` for so many steps."""
        whole, rest = divmod(steps, self.tile.halo)
        return [self.tile.halo] * whole + [rest] * (rest > 0)

    def launch_in(self, bands: Bands, number: int, passes: int) -> None:
        """Launch the kernel `tiles` as `launch`, band by band."""
        (across, _), threads, _, shared = self._grid

        def one(first: int, end: int, stream: Stream) -> None:
            self._kernel[(across, end - first), threads, stream, shared](*self._arguments(number, passes, first))

        bands.each(one)
        self.simulation._current = 1 - self.simulation._current


def _owns(tile: Tile, number: int, count: int, masses: int, rows: int, end: int) -> bool:
    """Return True if row of tiles `number` of `count` owns or reads one of the first (`end` 0) or the last (`end` 1)
    `rows` of the `masses` along that axis."""
    _, first, last = owned(number, count, masses, tile.rows, tile.halo)
    return last > masses - rows - tile.halo if end else first < rows + tile.halo
