"""Cells of a fluid's grid: which one a coordinate lies in, how many there are, which lie around one.

A grid is dense over the particles' box, x fastest: cell (x, y, z) of (nx, ny, nz) has the number (z ny + y) nx + x. Along a
side that repeats (`fixed` cells of it) the grid wraps. Where more cells are needed than there is room for, the widest open
axis is halved and wraps, too: cells far apart then share a place, which costs nothing but a look at particles too far away,
and a single particle that fell out of the scene makes no cell larger. No axis that wraps has fewer than NARROWEST cells, so
that the three cells around a particle are three.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from model.formulas import plain

NARROWEST = 4
FARTHEST = 2**30  # cells from the grid's corner: what is farther, and what is no number, lies in cell 0


def make(real, compiled=plain):
    """`scaled`, `cell_of` and `cells_along` in the arithmetic `real`."""
    farthest, one = real(FARTHEST), np.int32(1)

    @compiled
    def scaled(x, low, inverse):
        """How many cells a coordinate is from the grid's corner."""
        return (x - low) * inverse

    @compiled
    def cell_of(x, low, inverse):
        """The cell that a coordinate lies in, along one axis; `inverse`: cells a metre."""
        place = scaled(x, low, inverse)
        cell = np.int32(0)
        if abs(place) <= farthest:  # false for NaN, whose conversion is another number on each machine
            cell = np.int32(place)
            if place < real(cell):
                cell = np.int32(cell - one)
        return cell

    @compiled
    def cells_along(low, high, inverse):
        """How many cells there are from the lowest to the highest coordinate; 1 of a box that holds nothing."""
        return np.int32(max(np.int32(0), cell_of(high, low, inverse)) + one)

    return SimpleNamespace(scaled=scaled, cell_of=cell_of, cells_along=cells_along)


def make_numbers(compiled=plain):
    """What is whole numbers: `fitted`, `wrapped`, `beside`, `first_piece`, `second_piece`."""
    narrowest = np.int64(NARROWEST)

    @compiled
    def over(x, y, z, most):
        """Whether a grid has more than `most` cells."""
        return x > most or y > most or z > most or x * y > most or x * y * z > most

    @compiled
    def halved(count):
        return max(narrowest, (count + np.int64(1)) // np.int64(2))

    @compiled
    def fitted(x, y, z, fixed_x, fixed_y, fixed_z, most):
        """(cells along x, y, z) of a grid of `most` cells at most. `fixed`: so many along that side, which repeats, or 0."""
        nx, ny, nz, most = np.int64(x), np.int64(y), np.int64(z), np.int64(most)
        if fixed_x > 0:
            nx = np.int64(fixed_x)
        if fixed_y > 0:
            ny = np.int64(fixed_y)
        if fixed_z > 0:
            nz = np.int64(fixed_z)
        while over(nx, ny, nz, most):
            open_x = np.int64(0) if fixed_x > 0 else nx
            open_y = np.int64(0) if fixed_y > 0 else ny
            open_z = np.int64(0) if fixed_z > 0 else nz
            if max(open_x, max(open_y, open_z)) <= narrowest:
                break
            if open_x >= open_y and open_x >= open_z:
                nx = halved(nx)
            elif open_y >= open_z:
                ny = halved(ny)
            else:
                nz = halved(nz)
        return np.int32(nx), np.int32(ny), np.int32(nz)

    @compiled
    def wrapped(cell, count, wraps):
        """The cell's place along an axis of `count` cells; of one that does not wrap, the nearest one of the grid."""
        if 0 <= cell < count:
            return np.int32(cell)
        if wraps:
            return np.int32(cell - (cell // count) * count)
        return np.int32(0) if cell < 0 else np.int32(count - 1)

    @compiled
    def beside(place, way, count, wraps):
        """The place `way` (-1, 0, 1) cells on, or -1 where there is none."""
        found = np.int32(place + way)
        if found < 0:
            return np.int32(count - 1) if wraps else np.int32(-1)
        if found >= count:
            return np.int32(0) if wraps else np.int32(-1)
        return found

    @compiled
    def first_piece(place, count, wraps):
        """(first cell, how many) of those around `place` along a row, up to where the row ends and begins anew."""
        if place == 0:
            if wraps:
                return np.int32(count - 1), np.int32(1)
            return np.int32(0), np.int32(min(count, 2))
        return np.int32(place - 1), np.int32(min(count - place + 1, 3))

    @compiled
    def second_piece(place, count, wraps):
        """(first cell, how many) of those behind the row's end; none where the row does not wrap, or goes on."""
        if wraps:
            if place == 0:
                return np.int32(0), np.int32(2)
            if place == count - 1:
                return np.int32(0), np.int32(1)
        return np.int32(0), np.int32(0)

    return SimpleNamespace(
        fitted=fitted, wrapped=wrapped, beside=beside, first_piece=first_piece, second_piece=second_piece
    )
