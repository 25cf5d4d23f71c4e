"""Arrays of Newton's method on tetrahedra for the CUDA kernel, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray
from softlab.model.tetrahedra.aggregates import Aggregates, Couplings
from softlab.model.tetrahedra.block_rows import BlockRows
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix
from softlab.model.tetrahedra.springs import SpringArrays


class Vectors(NamedTuple):
    """Quads of every particle.

    The state; old position, with its weight; inertial position; position after the last step; the potential's gradient
    there, and at a trial; a step; its residual; the matrix times the direction; preconditioned residual; the direction,
    two alternating ones in `fast` math; for a substep with stages, velocities at its start, and for dampers positions
    at the first stage's start and end.
    """

    position: DeviceArray
    velocity: DeviceArray
    before: DeviceArray
    target: DeviceArray
    current: DeviceArray
    gradient: DeviceArray
    trial: DeviceArray
    solution: DeviceArray
    residual: DeviceArray
    product: DeviceArray
    better: DeviceArray
    direction: DeviceArray
    start: DeviceArray
    origin: DeviceArray
    middle: DeviceArray


class Coarse(NamedTuple):
    """Arrays of the coarse level.

    Centres of the groups with their scales (quads); the band of the matrix, then of its factor, `width` numbers per row
    from the diagonal on; for each row the inverse of the factor's diagonal, the matrix's diagonal, the right-hand side
    and solution; in `fast` math the inverses of the bodies' matrices, one after the other.
    """

    centres: DeviceArray
    band: DeviceArray
    pivots: DeviceArray
    entries: DeviceArray
    solved: DeviceArray
    inverse: DeviceArray
    width: np.int32


class Solver(NamedTuple):
    """All arrays; `pins`: for each pinned particle the start of its row in `bodies`, 0 for a free one, empty if none
    moves."""

    elements: Elements
    rows: BlockRows
    springs: SpringArrays
    vectors: Vectors
    matrix: Matrix
    groups: Aggregates
    pairs: Couplings
    coarse: Coarse
    pins: DeviceArray
