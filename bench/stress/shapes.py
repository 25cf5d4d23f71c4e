"""States of the hard cases as text, for small pictures: rounded, and thinned if they are large."""

from __future__ import annotations

import json

import numpy as np


def bodies_as_text(position: np.ndarray, body: np.ndarray, most: int = 400) -> str:
    """Return positions (particles, 3) as JSON, a list for each `body` (particles,), at most `most` in total, rounded as
    in `as_text`.
    """
    stride = -(-len(position) // most)
    near = _rounded(np.asarray(position, dtype=np.float64))
    return json.dumps([near[body == k][::stride].tolist() for k in np.unique(body)], separators=(",", ":"))


def as_text(position: np.ndarray, rows: int, columns: int, most: int = 33) -> str:
    """Return positions (particles, dimensions) as JSON, at most `most` rows and columns, to 1e-3 of their extent."""
    flat = np.asarray(position, dtype=np.float64)
    dimensions = flat.shape[-1]
    grid = flat.reshape(rows, columns, dimensions)
    drawn = [np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)) for count in (rows, columns)]
    grid = grid[np.ix_(*drawn)]
    return json.dumps(_rounded(grid).tolist(), separators=(",", ":"))


def _rounded(position: np.ndarray) -> np.ndarray:
    """Return positions (..., dimensions) rounded to 1e-3 of their extent."""
    extent = float(np.ptp(position.reshape(-1, position.shape[-1]), axis=0).max())
    unit = 10.0 ** np.floor(np.log10(extent / 1000)) if extent > 0 and np.isfinite(extent) else 1e-3
    digits = max(0, round(-float(np.log10(unit))))
    return np.round(position, digits) if digits < 300 else position
