"""Arrays of Newton's method on tetrahedra for the CPU kernels, by name. Vectors are (particles, 3), blocks 3 x 3 by rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.model.tetrahedra.aggregates import Aggregates
from softlab.model.tetrahedra.block_rows import BlockRows
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix
from softlab.model.tetrahedra.springs import SpringArrays

Empty = tuple[()]


class Inputs(NamedTuple):
    """Inputs of a step besides its state: constants, integers of random forces, surface triangles, colliders, driven
    pins."""

    parameters: np.ndarray
    integers: np.ndarray
    wind_lists: tuple[np.ndarray, ...]
    bodies: np.ndarray
    kinds: np.ndarray
    driven: np.ndarray


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
    first_velocity: np.ndarray | Empty = ()
    first_start: np.ndarray | Empty = ()
    first_end: np.ndarray | Empty = ()


class Coarse(NamedTuple):
    """Centres of groups and their scales (groups, 4); the band of the matrix, then of its factor U'U, from the diagonal on
    (6 groups, width); right-hand side, then solution (1, 6 groups); the diagonal before factoring (1, 6 groups)."""

    centres: np.ndarray
    band: np.ndarray
    solution: np.ndarray
    diagonal: np.ndarray


class Since(NamedTuple):
    """States that dampers resist changes from: 1 / h, positions at the start of the stage, positions at the first
    stage's start and end, true in the second stage."""

    rate: float
    before: np.ndarray
    origin: np.ndarray
    middle: np.ndarray
    second: bool


class Solver(NamedTuple):
    """Arrays besides the state and `Inputs`; `sums`: by groups of particles or tetrahedra (2, groups)."""

    elements: Elements
    rows: BlockRows
    springs: SpringArrays
    vectors: Vectors
    matrix: Matrix
    sums: np.ndarray
    groups: Aggregates
    coarse: Coarse
