"""The table of cells into which a fluid's particles are sorted: from a bounding box of positions to a count along each
axis."""

from __future__ import annotations

from softlab.model.base.variant import formula, integer_formula, real

MOST_ALONG = 1e9  # cells along an axis: fits a 32-bit integer


@formula
def cells_along(low, high, inverse):
    """Number of cells from low to high [m], at least one. `inverse`: 1 / cell length [1/m]."""
    cells = min((high - low) * inverse, MOST_ALONG)
    return int(cells) + 1 if cells > 0.0 else 1


@formula
def halved(inverse):
    """1 / length of cells of twice the length [1/m]."""
    return inverse * 0.5


@formula
def cell_of(place, low, inverse, count):
    """Index of the cell of a coordinate among `count` cells along an axis. Coordinates beyond the ends are in the
    last or the first cell, NaN in the first."""
    cells = (place - low) * inverse
    if not cells > 0.0:
        return 0
    return int(cells) if cells < real(count) else count - 1


@integer_formula
def fits(nx, ny, nz, most):
    return nx <= most and ny <= most // nx and nz <= most // (nx * ny)
