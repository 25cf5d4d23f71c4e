"""Arrays of Newton's method on tetrahedra for the CUDA kernel, by name. Arrays that a scene does not need are empty on
the host, and not read on the device."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.tetrahedra.newton_sums import UNIT
from softlab.model.base.types import Real
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.tetrahedra.aggregates import MODES, Aggregates, Couplings, aggregates, couplings
from softlab.model.tetrahedra.block_rows import BLOCKS, BlockRows, block_rows
from softlab.model.tetrahedra.material import material_of
from softlab.model.tetrahedra.newton import SUMMED, element_values, holding, stage_vectors
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix
from softlab.model.tetrahedra.springs import SpringArrays, Springs

Array = np.ndarray | DeviceArray


class Vectors(NamedTuple):
    """Quads of every particle.

    The state; old position, with its weight; inertial position; position after the last step; the potential's gradient
    there, and at a trial; a step; its residual; the matrix times the direction; preconditioned residual; the direction,
    two alternating ones in `fast` math; for a substep with stages, velocities at the start of the first one, and for
    dampers positions at its start and end.
    """

    position: Array
    velocity: Array
    before: Array
    target: Array
    current: Array
    gradient: Array
    trial: Array
    solution: Array
    residual: Array
    product: Array
    preconditioned: Array
    direction: Array
    first_velocity: Array
    first_start: Array
    first_end: Array


class Coarse(NamedTuple):
    """Arrays of the coarse level.

    Centres of the groups with their scales (quads); the band of the matrix, then of its factor, `width` numbers per row
    from the diagonal on; for each row the inverse of the factor's diagonal, the matrix's diagonal, the right-hand side
    and solution; in `fast` math the inverses of the bodies' matrices, one after the other.
    """

    centres: Array
    band: Array
    pivots: Array
    entries: Array
    solved: Array
    inverse: Array
    width: np.int32


class Solver(NamedTuple):
    """All arrays; `pins`: for each pinned particle the start of its row in the colliders' array, 0 for a free one."""

    elements: Elements
    rows: BlockRows
    springs: SpringArrays
    vectors: Vectors
    matrix: Matrix
    groups: Aggregates
    pairs: Couplings
    coarse: Coarse
    pins: Array


class Control(NamedTuple):
    """Memory of all blocks besides the solver: two alternating buffers of the sums of groups, one after the other; `flags`
    (1,) int32 of the barrier, 0 before a launch; `done` (DONE,) int64, which is incremented."""

    sums: Array
    flags: Array
    done: Array


class Limits(NamedTuple):
    """Steps of a launch, solves of a step, Newton steps of a solve; `floor`: residuals below it are not reduced
    further."""

    steps: np.int64
    solves: np.int64
    iterations: np.int64
    floor: Any


class Time(NamedTuple):
    """Number of the step, if the variant needs it, and of the solve, counted from time 0."""

    step: np.int64
    number: np.int64


def solver_on_host(
    tetrahedra_set: TetrahedraSet, springs: Springs, free: np.ndarray, real: Real, math: str, parts: frozenset[str]
) -> Solver:
    """Return the arrays before the first step, without the state and pins; `free` (particles,) bool."""
    corners, count = tetrahedra_set.tetrahedra, tetrahedra_set.particle_count
    rows = block_rows(corners, count, springs.pairs)
    groups = aggregates(tetrahedra_set, rows, free)
    pairs = couplings(groups, rows)

    def zeros(numbers: int) -> np.ndarray:
        return np.zeros(numbers, real)

    quads, more, fast = SIZE * count, stage_vectors(parts), math != "exact"
    sizes = (0, 0, *[quads] * 9, (1 + fast) * quads, *(quads if number < more else 0 for number in range(3)))
    vectors = Vectors(*map(zeros, sizes))
    element_blocks = zeros(9 * (BLOCKS * len(corners) + len(springs.blocks)))
    element_blocks[9 * BLOCKS * len(corners) :] = springs.blocks.ravel()
    matrix = Matrix(
        element_blocks, zeros(9 * len(rows.columns)), zeros(6 * count), zeros(4 * SIZE * len(corners)),
        holding(tetrahedra_set).astype(real),
    )  # fmt: skip
    size = MODES * groups.number
    coarse = Coarse(
        zeros(SIZE * groups.number), zeros(size * groups.width), zeros(size), zeros(size), zeros(size),
        zeros(int(pairs.places[-1]) if fast else 0), np.int32(groups.width),
    )  # fmt: skip
    materials, values = material_of(tetrahedra_set), element_values(tetrahedra_set).T
    elements = Elements(corners.astype(np.int32), materials.astype(np.int32), values.astype(real))
    return Solver(
        elements, rows, springs.arrays(real), vectors, matrix, groups, pairs, coarse, np.zeros(0, np.int32)
    )  # fmt: skip


def mapped(arrays: Any, change: Callable[[np.ndarray], Any]) -> Any:
    """Return nested named tuples with `change` of each array; numbers are left as they are."""
    if isinstance(arrays, tuple):
        return type(arrays)(*(mapped(one, change) for one in arrays))
    return change(arrays) if isinstance(arrays, np.ndarray) else arrays


def launch_sizes(solver: Solver) -> tuple[int, int]:
    """Return (thread blocks that the largest pass can use, the most partial sums of one)."""
    tetrahedra, particles, groups = len(solver.elements.materials), len(solver.matrix.stiffness), solver.groups.number
    sums = max(-(-max(particles, tetrahedra) // SUMMED), groups)
    return max(-(-tetrahedra // UNIT), -(-particles // SUMMED), groups), sums
