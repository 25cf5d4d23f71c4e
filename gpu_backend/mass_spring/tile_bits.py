"""Masses of a thread's strip as bits of an integer: bit r is mass r, r rows below the strip's first one."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.tiling import Tile
from softlab.model.base.variant import FEATURE, inlined_routine


def tile_features(tile: Tile) -> dict[str, int]:
    """Return the features of kernels on a tile."""
    return {"halo": tile.halo, "strip": tile.strip, "tile_columns": tile.columns, "tile_rows": tile.rows}


@inlined_routine
def bits_between(first, end, i):
    """Return the bits r with first <= i + r < end."""
    bits = np.int32(0)
    for r in range(FEATURE.strip):
        row = i + np.int32(r)
        if row >= first and row < end:
            bits = bits | np.int32(1 << r)
    return bits
