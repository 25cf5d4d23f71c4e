"""Rows and columns of points: where they lie at rest, the cells between them, and two triangles for each cell."""

from __future__ import annotations

import numpy as np


def sheet_positions(rows: int, columns: int, spacing: float, axes: int = 3, flat: bool = False) -> np.ndarray:
    """Return (rows, columns, axes) float64 [m]: (column * spacing, -row * spacing) in the plane of x and y, row 0 on
    top; `flat`: with the rows along +z instead."""
    position = np.zeros((rows, columns, axes))
    position[..., 0] = np.arange(columns) * spacing
    down = (np.arange(rows) * spacing)[:, None]
    position[..., 2 if flat else 1] = down if flat else -down
    return position


def cell_corners(sheet: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Views (rows - 1, columns - 1, ...) of a `sheet` (rows, columns, ...) at each cell's first corner, the one right of it,
    the one below it, and the one opposite."""
    return sheet[:-1, :-1], sheet[:-1, 1:], sheet[1:, :-1], sheet[1:, 1:]


def split_cells(numbers: np.ndarray, rising: np.ndarray | bool = False) -> np.ndarray:
    """Return (rows - 1, columns - 1, 2, 3): the two triangles of each cell of `numbers` (rows, columns), split from its
    first corner to the one opposite, or where `rising` (rows - 1, columns - 1) bool the other way.

    Counter-clockwise from where columns run to the right and rows down.
    """
    a, b, c, d = cell_corners(numbers)
    first = a, c, np.where(rising, b, d)
    second = np.where(rising, b, a), np.where(rising, c, d), np.where(rising, d, b)
    return np.stack([*first, *second], axis=-1).reshape(*a.shape, 2, 3)


def sheet_triangles(rows: int, columns: int, diagonals: str = "one") -> np.ndarray:
    """Return (2 (rows - 1) (columns - 1), 3) uint32: two triangles a cell, split from its first mass to the one
    opposite; of `alternating` diagonals the cells of odd row + column the other way.

    Counter-clockwise from where a hanging cloth is seen from +z, a flat one from above.
    """
    i, j = np.indices((rows - 1, columns - 1), sparse=True)
    numbers = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    return split_cells(numbers, (i + j) % 2 == 1 if diagonals == "alternating" else False).reshape(-1, 3)
