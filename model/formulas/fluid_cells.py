"""Cells of a fluid's grid: which one a coordinate lies in, and how many there are along an axis."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from model.formulas import plain

FARTHEST = 1e9  # cells along an axis at most


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    farthest, zero, half = real(FARTHEST), real(0), real(0.5)

    @compiled
    def cell_of(x, low, inverse, count):
        """The cell that a coordinate lies in, of `count` along an axis; the first of what is no number. `inverse`: cells a
        metre."""
        place, last = (x - low) * inverse, np.int32(count - 1)
        if place >= farthest:
            return last
        return min(np.int32(place), last) if place > zero else np.int32(0)

    @compiled
    def cells_along(low, high, inverse):
        """How many cells there are from the lowest to the highest coordinate."""
        return np.int32(np.int32(min((high - low) * inverse, farthest)) + 1)

    @compiled
    def coarser(inverse):
        """Cells a metre of cells twice as large."""
        return inverse * half

    @compiled
    def repeated(cells, side):
        """Cells a metre of a side [m] that repeats."""
        return cells / side

    return SimpleNamespace(cell_of=cell_of, cells_along=cells_along, coarser=coarser, repeated=repeated)
