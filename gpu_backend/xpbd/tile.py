"""Partition of a sheet into tiles whose blocks project all colours of an iteration on their own: pure arithmetic.

After an iteration a block's own masses would be wrong without the masses that they depend on (model/xpbd/reach.py), so
it loads these, too, and projects their constraints again: the halo. With all twelve families and an owned part that
begins at a multiple of 4 plus 2 (then the last colour ends inside), the halo of an iteration is 4 rows and 8 columns on
either side.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from softlab.model.xpbd.reach import PERIOD, dependencies


@dataclass(frozen=True)
class Span:
    """A tile along one axis: it loads `size` masses, of which `before` are before the `owned` ones; tile 0 owns from
    `start` <= 0 on, the next from start + owned, and so on."""

    size: int
    owned: int
    before: int = 0
    start: int = 0

    @property
    def phase(self) -> int:
        """Position of every tile's first mass in the period of colours: 0 or 2."""
        return (self.start - self.before) % PERIOD

    def count(self, masses: int) -> int:
        """Return the number of tiles that own all of `masses`."""
        return -(-(masses - self.start) // self.owned)


@dataclass(frozen=True)
class SheetTile:
    """The masses of one block, and its threads."""

    rows: Span
    columns: Span
    threads: int

    @property
    def pitch(self) -> int:
        """Quads from a row to the next in shared memory: odd, so that neither rows nor columns have bank conflicts."""
        return self.columns.size | 1

    @property
    def quads(self) -> int:
        return self.rows.size * self.pitch

    @property
    def name(self) -> str:
        """Name of the tile, such as 40x48_32x32_2m2_512: loaded, owned, phases, threads."""
        sizes = f"{self.rows.size}x{self.columns.size}_{self.rows.owned}x{self.columns.owned}"
        begins = f"{self.rows.before}b{-self.rows.start}_{self.columns.before}b{-self.columns.start}"
        return f"{sizes}_{begins}_{self.threads}"


@cache
def span(parts: frozenset[str], along_rows: bool, owned: int, iterations: int = 1) -> Span:
    """Return the tile along an axis that owns `owned` masses (a multiple of PERIOD), placed so that its halo is
    smallest."""
    candidates = []
    for offset in (0, 2):
        first, end = dependencies(parts, along_rows, offset, offset + owned, iterations)
        before = offset - first + (offset - first) % 2
        size = before + end - offset
        candidates.append(Span(size + size % 2, owned, before, offset - PERIOD if offset else 0))
    return min(candidates, key=lambda s: s.size)


def whole(rows: int, columns: int, threads: int) -> SheetTile:
    """Return the single tile of a sheet that fits into a block; sides are even, so that halves of them are whole."""
    down, across = rows + rows % 2, columns + columns % 2
    return SheetTile(Span(down, down), Span(across, across), threads)
