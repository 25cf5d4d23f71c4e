"""Partition of a grid into overlapping tiles: pure arithmetic, for the kernels, their launches and their tests.

A tile of a block is `columns` wide and `strips * strip` rows high; each thread has a strip of `strip` masses of one
column in registers. Advanced by itself, a tile loses one ring of masses per step, those that an outside neighbour would
have pulled. So it has a halo: with `halo` rings a block can do `halo` steps before it must read its neighbours, and it
owns, and writes, the interior. Tiles start every (size - 2 halo) masses; at the grid's own edges nothing is lost, so
the first and the last tile own up to the edge.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tile:
    """The masses of one block: `columns` x (`strips` x `strip`), of which `halo` rings belong to the neighbours."""

    columns: int
    strips: int
    strip: int
    halo: int = 0

    @property
    def rows(self) -> int:
        return self.strips * self.strip

    @property
    def threads(self) -> int:
        return self.columns * self.strips

    @property
    def masses(self) -> int:
        return self.rows * self.columns

    @property
    def name(self) -> str:
        """Name of the tile, such as 64x8x8h4: columns, strips, masses per strip, halo."""
        return f"{self.columns}x{self.strips}x{self.strip}h{self.halo}"


def tile_count(masses: int, size: int, halo: int) -> int:
    """Return the number of tiles along an axis of `masses`, for tiles of `size` with `halo`.

    The last tile reaches the edge, and owns more than `halo` masses, so that a halo never spans two neighbours.
    """
    if masses <= size:
        return 1
    return -((2 * halo - masses) // (size - 2 * halo))


def owned(index: int, count: int, masses: int, size: int, halo: int) -> tuple[int, int, int]:
    """Return (first mass of tile `index` of `count`, first mass it owns, first mass after those it owns) along an
    axis."""
    start = index * (size - 2 * halo)
    first = start + halo if index > 0 else 0
    end = start + size - halo if index < count - 1 else masses
    return start, first, end


def whole_strips(rows: int, tile: Tile) -> bool:
    """Return True if the grid's last row is the last of a strip in every tile: then the edge cuts no strip.

    Tiles start at multiples of (tile.rows - 2 halo), which must be a whole number of strips too.
    """
    return rows % tile.strip == 0 and (2 * tile.halo) % tile.strip == 0
