"""Arrays of Newton's method on tetrahedra for the CPU kernels, by name. Vectors are (particles, 3), blocks 3 x 3 by rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Absent = tuple[()]


class Inputs(NamedTuple):
    """What a step reads besides its state: constants, integers of random forces, surface triangles, colliders, pins that
    are driven."""

    parameters: np.ndarray
    integers: np.ndarray
    wind_lists: tuple[np.ndarray, ...]
    bodies: np.ndarray
    kinds: np.ndarray
    driven: np.ndarray


class Elements(NamedTuple):
    """Corners (tetrahedra, 4), materials and values (AT_ of model/tetrahedra/newton.py) of tetrahedra."""

    corners: np.ndarray
    materials: np.ndarray
    values: np.ndarray


class Springs(NamedTuple):
    """Springs of attachments (model/tetrahedra/springs.py)."""

    meets: np.ndarray
    entries: np.ndarray
    corners: np.ndarray
    values: np.ndarray


class Rows(NamedTuple):
    """Rows of the matrix (model/tetrahedra/block_rows.py)."""

    starts: np.ndarray
    columns: np.ndarray
    diagonal: np.ndarray
    sources: np.ndarray
    items: np.ndarray
    meets: np.ndarray
    corners: np.ndarray


class Matrix(NamedTuple):
    """Blocks of tetrahedra and of springs, blocks of rows, inverses of the diagonal as six numbers, forces at corners,
    stiffness that holds each particle [N/m]."""

    element_blocks: np.ndarray
    blocks: np.ndarray
    inverses: np.ndarray
    forces: np.ndarray
    stiffness: np.ndarray


class Vectors(NamedTuple):
    """Inertial positions, current iterate, gradient of the potential, gradient at a trial, solution, residual, direction,
    product of the matrix or preconditioned residual; for order 2 the velocities at the start of a substep's first stage,
    and with dampers the positions at its start and end."""

    target: np.ndarray
    current: np.ndarray
    gradient: np.ndarray
    trial: np.ndarray
    solution: np.ndarray
    residual: np.ndarray
    direction: np.ndarray
    product: np.ndarray
    first_velocity: np.ndarray | Absent = ()
    first_start: np.ndarray | Absent = ()
    first_end: np.ndarray | Absent = ()


class Groups(NamedTuple):
    """Groups of particles of the coarse level (model/tetrahedra/aggregates.py)."""

    starts: np.ndarray
    members: np.ndarray
    group_of: np.ndarray
    reach: np.ndarray


class Coarse(NamedTuple):
    """Centres of groups and their scales (groups, 4); the band of the matrix, then of its factor U'U, from the diagonal on
    (6 groups, width); right-hand side, then solution (1, 6 groups); the diagonal before factoring (1, 6 groups)."""

    centres: np.ndarray
    band: np.ndarray
    solution: np.ndarray
    diagonal: np.ndarray


class Solver(NamedTuple):
    """All of the above but `Inputs`, and sums by groups of particles or tetrahedra (2, groups)."""

    elements: Elements
    rows: Rows
    springs: Springs
    vectors: Vectors
    matrix: Matrix
    sums: np.ndarray
    groups: Groups
    coarse: Coarse
