"""The table of cells into which a fluid's particles are sorted: from a bounding box of positions to a count along each
axis."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain

MOST_ALONG = 1e9  # cells along an axis: fits a 32-bit integer


def make(real, compiled=plain):
    """Make `cells_along`, `halved` and `cell_of` in the arithmetic `real`."""
    zero, half, most_along = real(0), real(0.5), real(MOST_ALONG)

    @compiled
    def cells_along(low, high, inverse):
        """Number of cells from low to high [m], at least one. `inverse`: 1 / cell length [1/m]."""
        cells = min((high - low) * inverse, most_along)
        return int(cells) + 1 if cells > zero else 1

    @compiled
    def halved(inverse):
        """1 / length of cells twice as long [1/m]."""
        return inverse * half

    @compiled
    def cell_of(place, low, inverse, count):
        """Index of the cell of a coordinate among `count` cells along an axis. Coordinates beyond the ends are in the
        last or the first cell, NaN in the first."""
        cells = (place - low) * inverse
        if not cells > zero:
            return 0
        return int(cells) if cells < real(count) else count - 1

    return SimpleNamespace(cells_along=cells_along, halved=halved, cell_of=cell_of)


def make_fits(compiled=plain):
    """Make fits(nx, ny, nz, most): True if nx ny nz cells are at most `most`, without a product that overflows."""

    @compiled
    def fits(nx, ny, nz, most):
        return nx <= most and ny <= most // nx and nz <= most // (nx * ny)

    return fits
