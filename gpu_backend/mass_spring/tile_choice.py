"""Choice of a kernel and its tile from tables of measured times, for grids and cloths."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from softlab.gpu_backend.core.tiling import Tile, parsed_tile


def measured_tiles(
    table: Mapping[str, Mapping[int, float]],
    processors: int,
    blocks_of: Callable[[Tile], int],
    fits: Callable[[Tile], bool],
) -> list[tuple[Tile, float | None]]:
    """Return (tile, us per step if measured) of a table's tiles that fit a sheet. `table`: times by the blocks that
    share a multiprocessor; `blocks_of(tile)`: blocks over the sheet."""
    tiles: list[tuple[Tile, float | None]] = []
    for name, by_blocks in table.items():
        tile = parsed_tile(name)
        if fits(tile):
            each = -(-blocks_of(tile) // processors)
            tiles.append((tile, min((time for count, time in by_blocks.items() if count >= each), default=None)))
    return tiles


def fastest(times: Mapping[tuple[str, Tile | None], float]) -> tuple[str, Tile | None, str]:
    """Return (kernel, tile, reason) of the least of the times [us per step]."""
    (first, *others) = sorted(times, key=lambda choice: times[choice])
    reason = f"{times[first]:.2g} us per step by the table"
    if others:
        kernel, tile = others[0]
        reason += f", next {kernel}{f':{tile.name}' if tile else ''} with {times[others[0]]:.2g}"
    return *first, reason
