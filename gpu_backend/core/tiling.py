"""Tiles of a sheet, one for each block: their names, how many a multiprocessor runs, and how a grid is divided.

A tile of a block is `columns` wide and `strips * strip` rows high; each thread has a strip of `strip` masses of one
column in registers. Advanced by itself, a tile loses one ring of masses per step, those that an outside neighbour would
have pulled. So it has a halo: with `halo` rings a block can do `halo` steps before it must read its neighbours, and it
owns, and writes, the interior. Tiles start every (size - 2 halo) masses; at the grid's own edges nothing is lost, so
the first and the last tile own up to the edge.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from softlab.gpu_backend.core.device import simulated
from softlab.model.base.errors import SceneError

# of a multiprocessor (compute capability 9.0; smaller ones run fewer blocks)
SHARED_MEMORY = 227 << 10  # bytes
BLOCK_OVERHEAD = 1 << 10  # bytes of shared memory that the system reserves per block
REGISTERS, MAX_BLOCKS = 1 << 16, 32
MAX_THREADS = 1024  # per block


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


def parsed_tile(text: str) -> Tile:
    """Return the tile of a name such as 64x8x8h4: columns x threads down x masses per thread, then the halo."""
    match = re.fullmatch(r"(\d{1,4})x(\d{1,4})x(\d{1,2})h(\d{1,2})", text)
    numbers = [int(number) for number in match.groups()] if match else []
    if not match or min(numbers[:3]) < 1 or numbers[2] > 16:
        raise SceneError(
            "--kernel",
            text,
            "a tile is written like 64x8x8h4: columns, threads down, masses of a thread (1 to 16), halo",
        )
    return Tile(*numbers)


def blocks_together(tile: Tile, needed: int, registers: int) -> int:
    """Return the number of blocks that should fit on a multiprocessor, so that one computes while another waits for
    memory or neighbours: as many as shared memory, `needed` bytes each, and `registers` per thread allow, at least
    one."""
    if simulated():  # one after another
        return 1
    by_memory = SHARED_MEMORY // (needed + BLOCK_OVERHEAD)
    return max(1, min(by_memory, REGISTERS // (registers * tile.threads), MAX_BLOCKS))


def why_no_block(tile: Tile, needed: int, most_shared: int) -> str:
    """Return the reason why a block with `most_shared` bytes of shared memory cannot run a tile that takes `needed`, or
    ""."""
    if tile.threads > MAX_THREADS:
        return f"a tile of {tile.name} needs {tile.threads} threads, a block has at most {MAX_THREADS}"
    if needed > most_shared:
        return f"a tile of {tile.name} needs {needed} bytes of shared memory, a block has {most_shared}"
    return ""


def why_not_at_once(rows: int, columns: int, tile: Tile, blocks: int, together: int) -> str:
    """Return the reason why `blocks` tiles of a sheet do not run at once where `together` do, or ""."""
    if blocks <= together:
        return ""
    return f"{rows} x {columns} masses are {blocks} tiles of {tile.name}; this GPU runs {together} at once"


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
