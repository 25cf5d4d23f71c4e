"""The table of cells in which a fluid's particles are sorted: from a box of positions to a count along each axis."""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

MOST_ALONG = 1e9  # cells along an axis: what a whole number of 32 bits holds


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero, half, most_along = real(0), real(0.5), real(MOST_ALONG)

    @compiled
    def cells_along(low, high, inverse):
        """How many cells there are from low to high [m], as a whole number: one at least."""
        cells = min((high - low) * inverse, most_along)
        return int(cells) + 1 if cells > zero else 1

    @compiled
    def halved(inverse):
        """Of cells twice as long [1/m]."""
        return inverse * half

    @compiled
    def cell_of(place, low, inverse, count):
        """Which of `count` cells along an axis; the last or the first one for what lies beyond, the first for NaN."""
        cells = (place - low) * inverse
        if not cells > zero:
            return 0
        return int(cells) if cells < real(count) else count - 1

    return SimpleNamespace(cells_along=cells_along, halved=halved, cell_of=cell_of)


def make_fits(compiled=plain):
    """fits(nx, ny, nz, most): whether so many cells are no more than `most`, without a product that overflows."""

    @compiled
    def fits(nx, ny, nz, most):
        return nx <= most and ny <= most // nx and nz <= most // (nx * ny)

    return fits
