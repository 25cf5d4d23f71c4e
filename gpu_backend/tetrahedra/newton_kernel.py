"""The kernel of implicit tetrahedral bodies on CUDA: blocks that run the passes together, for whole steps.

Blocks are launched together and synchronise after every pass. The next pass depends on sums over all blocks
(model/formulas/elastic/newton.py): each block computes them from the sums of groups, in the CPU's order, so that all
make the same decision, and in `exact` math get the CPU's bits. The sums of groups alternate between two buffers, since
a fast block begins the next pass while a slow one still reads them.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import knows_time
from softlab.gpu_backend.core.meeting import make_meet
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.newton_coarse import Coarse
from softlab.gpu_backend.tetrahedra.newton_passes import (
    BACK,
    FACTOR,
    INVERT,
    make_coarse_passes,
    make_quick_passes,
    make_unit_passes,
)
from softlab.gpu_backend.tetrahedra.newton_rows import Matrix, Vectors
from softlab.gpu_backend.tetrahedra.newton_sums import ROOM, THREADS, UNIT, make_sums
from softlab.model.formulas.elastic import newton
from softlab.model.formulas.elastic.newton import (
    BEGIN,
    BLOCKS,
    CENTRES,
    COARSE,
    CORRECT,
    DIRECTION,
    FINISH,
    LOOK,
    MOVE,
    PRODUCT,
    RESTRICT,
    ROWS,
    SOLVE,
    UPDATE,
    WEIGH,
)
from softlab.model.tetrahedra.newton import SUMMED

DONE = ("solves", "looks", "matrices", "products", "steps")  # counters of a simulation
WORKING = len(Vectors._fields) - 4  # besides the state; two directions, and not the last three, which few scenes have


class Lists(NamedTuple):
    """Lists of model/tetrahedra: a tetrahedron's corners and material; BlockRows; Aggregates; Couplings; for each
    pinned particle the start of its row in `bodies`, 0 for a free one, empty if none moves; lists of Springs."""

    tetrahedra: Any
    materials: Any
    starts: Any
    columns: Any
    diagonal: Any
    sources: Any
    items: Any
    meets: Any
    corners: Any
    group_starts: Any
    members: Any
    group: Any
    reach: Any
    pair_starts: Any
    pair_first: Any
    pair_second: Any
    pair_blocks: Any
    block_row: Any
    bodies: Any
    body_of: Any
    places: Any
    pins: Any
    spring_meets: Any
    spring_entries: Any
    spring_corners: Any


def packed(lists: Lists) -> np.ndarray:
    """Return int32: the start of each list, and the end of the last; then the lists."""
    ends = np.cumsum([len(lists) + 1, *(one.size for one in lists)])
    return np.concatenate([ends, *(one.reshape(-1) for one in lists)]).astype(np.int32)


def _views(math: str) -> SimpleNamespace:
    """Make views of packed arrays: `vectors(position, velocity, working)`, `lists(tables)`, `coarse(lists, centres,
    band, unknowns, inverse)`.

    Written out in full: tuples of slices that functions make one by one take minutes to compile.
    """
    inline, one = inlined(math), np.int32(1)

    @inline
    def vectors(position, velocity, working):
        n, w = position.size, working
        return Vectors(
            position, velocity, w[:n], w[n : 2 * n], w[2 * n : 3 * n], w[3 * n : 4 * n], w[4 * n : 5 * n], w[5 * n : 6 * n],
            w[6 * n : 7 * n], w[7 * n : 8 * n], w[8 * n : 9 * n], w[9 * n : 11 * n], w[11 * n : 12 * n],
            w[12 * n : 13 * n], w[13 * n :],
        )  # fmt: skip

    @inline
    def lists(t):
        return Lists(
            t[t[0] : t[1]], t[t[1] : t[2]], t[t[2] : t[3]], t[t[3] : t[4]], t[t[4] : t[5]], t[t[5] : t[6]], t[t[6] : t[7]],
            t[t[7] : t[8]], t[t[8] : t[9]], t[t[9] : t[10]], t[t[10] : t[11]], t[t[11] : t[12]], t[t[12] : t[13]],
            t[t[13] : t[14]], t[t[14] : t[15]], t[t[15] : t[16]], t[t[16] : t[17]], t[t[17] : t[18]], t[t[18] : t[19]],
            t[t[19] : t[20]], t[t[20] : t[21]], t[t[21] : t[22]], t[t[22] : t[23]],
            t[t[23] : t[24]], t[t[24] : t[25]],
        )  # fmt: skip

    @inline
    def coarse(lists, centres, band, unknowns, inverse):
        many = np.int32(len(lists.reach))
        return Coarse(
            centres, band, unknowns[:many], unknowns[many : 2 * many], unknowns[2 * many : 3 * many], inverse,
            np.int32(band.size // max(many, one)),
        )  # fmt: skip

    return SimpleNamespace(vectors=vectors, lists=lists, coarse=coarse)


@cache
def make_newton(real: Any, math: str, parts: frozenset[str]) -> Any:
    """Compile kernel(position, velocity, working, values, found, blocks, inverses, forces, holding, springs, centres,
    band, unknowns, inverse, tables, sums, flags, done, record, bodies, integers, counter, steps, solves, iterations,
    floor).

    It does `steps` steps, of so many `solves` each, of the state in `position` and `velocity`. `working`: WORKING
    vectors of quads, for order 2 some more; `values`: of tetrahedra, column by column; then those of Matrix and Coarse,
    of which `unknowns` has three; `tables`: `packed`; `sums`: two buffers of the groups' sums; `flags` (1,) int32, 0
    before the launch; `done` (DONE,) int64 is incremented; `floor`: of residuals that are not reduced further.
    """
    views, dispatch, sum_up = _views(math), _make_dispatch(real, math, parts), _make_sum_up(real, math)
    vectors_of, lists_of, coarse_of = views.vectors, views.lists, views.coarse
    # always decided in exact math: the energy of a distant trial may be NaN, which fast math treats as a number
    after, meet = device_formulas(newton.make_control, real, "exact").after, make_meet(math)
    has_time, zero, quick = knows_time(parts), real(0), math != "exact"

    def newton_steps(
        position, velocity, working, values, found, blocks, inverses, forces, holding, springs, centres, band,
        unknowns, inverse, tables, sums, flags, done, record, bodies, integers, counter, steps, solves, iterations, floor,
    ):  # fmt: skip
        shared = cuda.shared.array(ROOM, real)
        world = World(record[0], bodies, integers)
        matrix = Matrix(found, blocks, inverses, forces, holding, springs)
        v, lists = vectors_of(position, velocity, working), lists_of(tables)
        coarse = coarse_of(lists, centres, band, unknowns, inverse)
        wanted, turn, flip, half = np.int32(cuda.gridDim.x), 0, 0, sums.size // 2
        first_thread = cuda.blockIdx.x == 0 and cuda.threadIdx.x == 0
        for number in range(steps * solves):
            step = np.int64(0)
            if has_time:
                step = counter[0] + number // solves
            time = step, step * solves + number % solves
            kind, counts = BEGIN, (0, 0, 0, 0, 0)
            kept = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
            while True:
                parts_of = sums[turn * half : (turn + 1) * half]
                shares = kept[5], kept[6], kept[7]
                dispatch(kind, v, matrix, lists, coarse, values, world, time, counts[1], flip, shares, shared, parts_of)
                wanted = meet(flags, wanted)
                if kind == FINISH:
                    break
                if kind == COARSE or (quick and kind == FACTOR) or (not quick and kind == RESTRICT):
                    kind = FACTOR if kind == COARSE else (INVERT if quick else BACK)
                    continue
                first, second = sum_up(kind, v, lists, shared, parts_of)
                if first_thread:
                    if kind == LOOK:
                        done[1] += 1
                    elif kind == ROWS:
                        done[2] += 1
                    elif kind == PRODUCT:
                        done[3] += 1
                if kind in (FACTOR, INVERT):
                    kind = COARSE
                elif kind == BACK:
                    kind = RESTRICT
                elif kind == PRODUCT:
                    flip = 1 - flip
                kind, counts, kept = after(kind, counts, kept, first, second, iterations, floor)
                if quick:
                    if kind in (RESTRICT, DIRECTION):  # already done, or done with the next pass
                        kind, counts, kept = after(kind, counts, kept, zero, zero, iterations, floor)
                turn = 1 - turn
            if first_thread:
                done[0] += 1
                done[4] += counts[3]

    variant = variant_name(real, math, parts)
    return make_kernel(newton_steps, f"newton_{variant}", launch_bounds=(THREADS, 1), **kernel_options(math))


def _make_dispatch(real: Any, math: str, parts: frozenset[str]) -> Any:
    """Make dispatch(kind, ...): this block's part of a pass."""
    units, coarse_pass = make_unit_passes(real, math, parts), make_coarse_passes(real, math)
    of_elements, of_particles, quick_pass = units.of_elements, units.of_particles, make_quick_passes(real, math)
    summed, unit_size, quad, quick = np.int32(SUMMED), np.int32(UNIT), np.int32(SIZE), math != "exact"

    @inlined(math)
    def dispatch(kind, v, matrix, lists, coarse, values, world, time, safe, flip, shares, shared, sums):
        block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
        particles, tetrahedra = np.int32(v.position.size // quad), np.int32(len(lists.materials))
        if kind in (LOOK, BLOCKS):
            for unit in range(block, (tetrahedra + unit_size - 1) // unit_size, blocks):
                of_elements(kind, unit, tetrahedra, v, matrix, lists, values, world, time[1], safe, shared, sums)
        elif kind in (CENTRES, COARSE, FACTOR, INVERT, RESTRICT, BACK):
            coarse_pass(kind, v, matrix, lists, coarse, shared, sums)
        elif quick and kind in (SOLVE, UPDATE, PRODUCT, CORRECT):
            quick_pass(kind, particles, v, matrix, lists, coarse, flip, shares, shared, sums)
        else:
            for group in range(block, (particles + summed - 1) // summed, blocks):
                of_particles(kind, group, particles, v, matrix, lists, coarse, world, time, shares, shared, sums)

    return dispatch


def _make_sum_up(real: Any, math: str) -> Any:
    """Make sum_up(kind, v, lists, shared, parts) -> the two sums of a pass, 0 if it has none."""
    total, zero, summed, quad = make_sums(real, math).total, real(0), np.int32(SUMMED), np.int32(SIZE)
    one_sum, two_sums, quick = np.int32(1), np.int32(2), math != "exact"

    @inlined(math)
    def sum_up(kind, v, lists, shared, parts):
        first, second, count = zero, zero, np.int32(0)
        if kind == LOOK:
            count = np.int32((len(lists.materials) + summed - 1) // summed)
        elif kind in (FACTOR, INVERT):
            count = np.int32(len(lists.bodies) - 1)
        elif quick and kind == CORRECT:
            count = np.int32(len(lists.body_of))
        elif kind in (WEIGH, ROWS, PRODUCT, CORRECT, MOVE):
            count = np.int32((v.position.size // quad + summed - 1) // summed)
        if count > 0:
            total(shared, two_sums if kind == LOOK else one_sum, count, parts)
            first = shared[0]
            if kind == LOOK:
                second = shared[1]
        cuda.syncthreads()
        return first, second

    return sum_up
