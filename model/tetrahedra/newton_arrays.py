"""Arrays of Newton's method on tetrahedra that both backends name alike: BlockRows, Aggregates, Couplings and SpringArrays
are those of block_rows.py, aggregates.py and springs.py. Blocks are 3 x 3 by rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Elements(NamedTuple):
    """Corners, materials and values (AT_ of newton.py) of tetrahedra: rows on the CPU; on the GPU corners are flat and
    values stored column by column."""

    corners: np.ndarray
    materials: np.ndarray
    values: np.ndarray


class Matrix(NamedTuple):
    """Blocks of tetrahedra and of springs, blocks of rows, inverses of the diagonal as six numbers of a particle (on the
    GPU column by column), forces at corners, stiffness that holds each particle [N/m]."""

    element_blocks: np.ndarray
    blocks: np.ndarray
    inverses: np.ndarray
    forces: np.ndarray
    stiffness: np.ndarray
