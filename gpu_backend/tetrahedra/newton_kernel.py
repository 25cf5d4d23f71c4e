"""The kernel of implicit tetrahedral bodies on CUDA: blocks that run the passes together, for whole steps.

Blocks are launched together and synchronise after every pass. The next pass depends on sums over all blocks
(model/formulas/elastic/newton.py): each block computes them from the sums of groups, in the CPU's order, so that all
make the same decision, and in `exact` math get the CPU's bits. The sums of groups alternate between two buffers, since
a fast block begins the next pass while a slow one still reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.forces import particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.meeting import barrier
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.newton_arrays import Coarse, Solver, Vectors
from softlab.gpu_backend.tetrahedra.newton_passes import (
    BACK,
    FACTOR,
    INVERT,
    coarse_pass,
    of_elements,
    of_particles,
    quick_pass,
)
from softlab.gpu_backend.tetrahedra.newton_sums import CAPACITY, THREADS, UNIT, total
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, real, routine
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.elastic import newton
from softlab.model.formulas.elastic.newton import (
    BEGIN,
    BLOCKS,
    CENTRES,
    COARSE,
    CORRECT,
    DIRECTION,
    ENERGIES,
    EVALUATIONS,
    FINISH,
    MATRICES,
    MOVE,
    PRODUCT,
    PRODUCTS,
    RESTRICT,
    ROWS,
    SOLVE,
    SOLVES,
    STEPS,
    UPDATE,
    WEIGH,
    Counts,
    Values,
)
from softlab.model.tetrahedra.aggregates import Aggregates, Couplings
from softlab.model.tetrahedra.block_rows import BlockRows
from softlab.model.tetrahedra.newton import SUMMED
from softlab.model.tetrahedra.newton_arrays import Elements, Matrix
from softlab.model.tetrahedra.springs import SpringArrays, kernel_features

WORKING = len(Vectors._fields) - 4  # besides the state; two directions, and not the last three, which few scenes have


def packed(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Return int32: the start of each array, and the end of the last; then the arrays."""
    ends = np.cumsum([len(arrays) + 1, *(one.size for one in arrays)])
    return np.concatenate([ends, *(one.reshape(-1) for one in arrays)]).astype(np.int32)


@inlined_routine
def vectors_of(position, velocity, working):
    """Return the arrays of particles by name. A device function can return a tuple of slices, but not a single
    slice."""
    n, w = position.size, working
    return Vectors(
        position, velocity, w[:n], w[n : 2 * n], w[2 * n : 3 * n], w[3 * n : 4 * n], w[4 * n : 5 * n], w[5 * n : 6 * n],
        w[6 * n : 7 * n], w[7 * n : 8 * n], w[8 * n : 9 * n], w[9 * n : 11 * n], w[11 * n : 12 * n],
        w[12 * n : 13 * n], w[13 * n :],
    )  # fmt: skip


@inlined_routine
def rows_of(t):
    """Return views of the `packed` arrays t, as do `groups_of` and `pairs_of`."""
    return BlockRows(
        t[t[2] : t[3]], t[t[3] : t[4]], t[t[4] : t[5]], t[t[5] : t[6]], t[t[6] : t[7]], t[t[7] : t[8]], t[t[8] : t[9]]
    )  # fmt: skip


@inlined_routine
def groups_of(t):
    return Aggregates(t[t[9] : t[10]], t[t[10] : t[11]], t[t[11] : t[12]], t[t[12] : t[13]])


@inlined_routine
def pairs_of(t):
    return Couplings(
        t[t[13] : t[14]], t[t[14] : t[15]], t[t[15] : t[16]], t[t[16] : t[17]], t[t[17] : t[18]], t[t[18] : t[19]],
        t[t[19] : t[20]], t[t[20] : t[21]],
    )  # fmt: skip


@inlined_routine
def dispatch(kind, solver, world, time, safe, flip, values, shared, sums):
    """Run this block's part of a pass."""
    block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    particles = np.int32(solver.vectors.position.size // SIZE)
    tetrahedra = np.int32(len(solver.elements.materials))
    if kind in (ENERGIES, BLOCKS):
        for unit in range(block, (tetrahedra + UNIT - 1) // UNIT, blocks):
            of_elements(kind, unit, tetrahedra, solver, world, time[1], safe, shared, sums)
    elif kind in (CENTRES, COARSE, FACTOR, INVERT, RESTRICT, BACK):
        coarse_pass(kind, solver, shared, sums)
    elif FEATURE.fast and kind in (SOLVE, UPDATE, PRODUCT, CORRECT):
        quick_pass(kind, particles, solver, flip, values, shared, sums)
    else:
        for group in range(block, (particles + SUMMED - 1) // SUMMED, blocks):
            of_particles(kind, group, particles, solver, world, time, values, shared, sums)


@inlined_routine
def sum_up(kind, solver, shared, parts):
    """Return the two sums of a pass, 0 if it has none."""
    first, second, count = 0.0, 0.0, np.int32(0)
    if kind == ENERGIES:
        count = np.int32((len(solver.elements.materials) + SUMMED - 1) // SUMMED)
    elif kind in (FACTOR, INVERT):
        count = np.int32(len(solver.pairs.bodies) - 1)
    elif FEATURE.fast and kind == CORRECT:
        count = np.int32(len(solver.pairs.body_of))
    elif kind in (WEIGH, ROWS, PRODUCT, CORRECT, MOVE):
        count = np.int32((solver.vectors.position.size // SIZE + SUMMED - 1) // SUMMED)
    if count > 0:
        total(shared, np.int32(2) if kind == ENERGIES else np.int32(1), count, parts)
        first = shared[0]
        if kind == ENERGIES:
            second = shared[1]
    cuda.syncthreads()
    return first, second


after = Open("after(...), of model/formulas/elastic/newton.py, in exact math")


@routine
def newton_steps(
    position, velocity, working, values, element_blocks, blocks, inverses, forces, stiffness, springs, centres, band,
    unknowns, inverse, tables, sums, flags, done, record, bodies, integers, counter, steps, solves, iterations, floor,
):  # fmt: skip
    """Do `steps` steps, of so many `solves` each, of the state in `position` and `velocity`.

    `working`: WORKING vectors of quads, for order 2 some more; `values`: of tetrahedra, column by column; then those of
    Matrix, `springs` and those of Coarse, of which `unknowns` has three; `tables`: `packed` corners and materials of
    tetrahedra, BlockRows, Aggregates, Couplings, pins and lists of springs; `sums`: two buffers of the groups' sums;
    `flags` (1,) int32, 0 before the launch; `done` (DONE,) int64 is incremented; `floor`: of residuals that are not
    reduced further.
    """
    shared = cuda.shared.array(CAPACITY, real)
    world = World(record[0], bodies, integers)
    t, v = tables, vectors_of(position, velocity, working)
    matrix = Matrix(element_blocks, blocks, inverses, forces, stiffness)
    elements, rows = Elements(t[t[0] : t[1]], t[t[1] : t[2]], values), rows_of(t)
    groups, pairs, pins = groups_of(t), pairs_of(t), t[t[21] : t[22]]
    sprung = SpringArrays(t[t[22] : t[23]], t[t[23] : t[24]], t[t[24] : t[25]], springs)
    size = np.int32(len(groups.reach))
    coarse = Coarse(
        centres, band, unknowns[:size], unknowns[size : 2 * size], unknowns[2 * size : 3 * size], inverse,
        np.int32(band.size // max(size, np.int32(1))),
    )  # fmt: skip
    solver = Solver(elements, rows, sprung, v, matrix, groups, pairs, coarse, pins)
    wanted, turn, flip, half = np.int32(cuda.gridDim.x), 0, 0, sums.size // 2
    first_thread = cuda.blockIdx.x == 0 and cuda.threadIdx.x == 0
    for number in range(steps * solves):
        step = np.int64(0)
        if FEATURE.timed:
            step = counter[0] + number // solves
        time = step, step * solves + number % solves
        kind, counts = BEGIN, Counts(np.int64(0), np.int64(0), np.int64(0), np.int64(0), np.int64(0))
        numbers = Values(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        while True:
            parts_of = sums[turn * half : (turn + 1) * half]
            dispatch(kind, solver, world, time, counts.safe, flip, numbers, shared, parts_of)
            wanted = barrier(flags, wanted)
            if kind == FINISH:
                break
            if kind == COARSE or (FEATURE.fast and kind == FACTOR) or (not FEATURE.fast and kind == RESTRICT):
                kind = FACTOR if kind == COARSE else (INVERT if FEATURE.fast else BACK)
                continue
            first, second = sum_up(kind, solver, shared, parts_of)
            if first_thread:
                if kind == ENERGIES:
                    done[EVALUATIONS] += 1
                elif kind == ROWS:
                    done[MATRICES] += 1
                elif kind == PRODUCT:
                    done[PRODUCTS] += 1
            if kind in (FACTOR, INVERT):
                kind = COARSE
            elif kind == BACK:
                kind = RESTRICT
            elif kind == PRODUCT:
                flip = 1 - flip
            kind, counts, numbers = after(kind, counts, numbers, first, second, iterations, floor)
            if FEATURE.fast:
                if kind in (RESTRICT, DIRECTION):  # already done, or done with the next pass
                    kind, counts, numbers = after(kind, counts, numbers, 0.0, 0.0, iterations, floor)
            turn = 1 - turn
        if first_thread:
            done[SOLVES] += 1
            done[STEPS] += counts.steps


@cache
def make_newton(real: Real, math: str, parts: frozenset[str]) -> Kernel:
    """Compile `newton_steps`."""
    names = {
        "touch": device_variant(real, math, particle_features(parts - {FRICTION_IN_PLACE}))(collide),
        # always decided in exact math: the energy of a distant trial may be NaN, which fast math treats as a number
        "after": device_variant(real, "exact")(newton.after),
    }  # fmt: skip
    features = particle_features(parts) | kernel_features(parts) | {"fast": math != "exact"}
    kernel = device_variant(real, math, features).copied(with_forces(filled(newton_steps, names), parts))
    label = f"newton_{variant_name(real, math, parts)}"
    return make_kernel(kernel, label, launch_bounds=(THREADS, 1), **kernel_options(math))
