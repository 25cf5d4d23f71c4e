"""The kernel of implicit tetrahedral bodies on CUDA: blocks that go through the passes together, for whole steps.

Blocks are launched together and meet after every pass. What follows hangs on sums over all
(model/formulas/elastic/newton.py): each block takes them for itself from the sums of groups, in the CPU's order, so that all
come to the same decision, and in `exact` math to the CPU's bits. The sums of groups lie in two places in turn, since a quick
block begins the next pass while a slow one still reads them.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from gpu_backend.core.compile import kernel_options, make_kernel, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.integers import knows_time
from gpu_backend.core.meeting import make_meet
from gpu_backend.core.quads import SIZE
from gpu_backend.core.world import World
from gpu_backend.tetrahedra.newton_coarse import Coarse
from gpu_backend.tetrahedra.newton_passes import BACK, FACTOR, make_coarse_passes, make_unit_passes
from gpu_backend.tetrahedra.newton_rows import Matrix, Vectors
from gpu_backend.tetrahedra.newton_sums import ROOM, THREADS, UNIT, make_sums
from model.formulas.elastic import newton
from model.formulas.elastic.newton import (
    BEGIN,
    BLOCKS,
    CENTRES,
    COARSE,
    CORRECT,
    DAMPER_BLOCKS,
    FINISH,
    LOOK,
    MOVE,
    PRODUCT,
    RESTRICT,
    ROWS,
    WEIGH,
)
from model.tetrahedra.newton import DAMPED, SUMMED

DONE = ("substeps", "looks", "matrices", "products", "steps")  # that a simulation has done
WORKING = len(Vectors._fields) - 2  # vectors beside the state


class Lists(NamedTuple):
    """Of model/tetrahedra: a tetrahedron's corners and material; BlockRows; Aggregates; Couplings."""

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


def packed(lists: Lists) -> np.ndarray:
    """int32: where each list begins, and the last ends; then the lists."""
    ends = np.cumsum([len(lists) + 1, *(one.size for one in lists)])
    return np.concatenate([ends, *(one.reshape(-1) for one in lists)]).astype(np.int32)


@cache
def make_newton(real: Any, math: str, parts: frozenset[str]) -> Any:
    """kernel(position, velocity, working, values, found, blocks, damper, inverses, forces, holding, centres, band, unknowns,
    tables, sums, flags, done, record, bodies, integers, counter, steps, substeps, iterations, floor): `steps` steps of the
    state in `position` and `velocity`. `working`: WORKING vectors of quads; `values`: of tetrahedra, column by column; then
    those of Matrix and Coarse, of which `unknowns` has three; `tables`: `packed`; `sums`: twice what groups sum up; `flags`
    (1,) int32, 0 before the launch; `done` (DONE,) int64 is added to; `floor`: of residuals that are left alone."""
    units, coarse_pass = make_unit_passes(real, math, parts), make_coarse_passes(real, math)
    of_elements, of_particles, total = units.of_elements, units.of_particles, make_sums(real, math).total
    after, meet = device_formulas(newton.make_control, real, math).after, make_meet(math)
    damped, has_time, zero = DAMPED in parts, knows_time(parts), real(0)
    summed, unit_size, quad, one_sum, two_sums = (
        np.int32(SUMMED),
        np.int32(UNIT),
        np.int32(SIZE),
        np.int32(1),
        np.int32(2),
    )

    def newton_steps(
        position, velocity, working, values, found, blocks, damper, inverses, forces, holding, centres, band, unknowns,
        tables, sums, flags, done, record, bodies, integers, counter, steps, substeps, iterations, floor,
    ):  # fmt: skip
        shared = cuda.shared.array(ROOM, real)
        world, matrix = World(record[0], bodies, integers), Matrix(found, blocks, damper, inverses, forces, holding)
        size = position.size
        v = Vectors(
            position, velocity, working[:size], working[size : 2 * size], working[2 * size : 3 * size],
            working[3 * size : 4 * size], working[4 * size : 5 * size], working[5 * size : 6 * size],
            working[6 * size : 7 * size], working[7 * size : 8 * size], working[8 * size : 9 * size],
            working[9 * size : 10 * size], working[10 * size : 11 * size],
        )  # fmt: skip
        lists = Lists(
            tables[tables[0] : tables[1]], tables[tables[1] : tables[2]], tables[tables[2] : tables[3]],
            tables[tables[3] : tables[4]], tables[tables[4] : tables[5]], tables[tables[5] : tables[6]],
            tables[tables[6] : tables[7]], tables[tables[7] : tables[8]], tables[tables[8] : tables[9]],
            tables[tables[9] : tables[10]], tables[tables[10] : tables[11]], tables[tables[11] : tables[12]],
            tables[tables[12] : tables[13]], tables[tables[13] : tables[14]], tables[tables[14] : tables[15]],
            tables[tables[15] : tables[16]], tables[tables[16] : tables[17]], tables[tables[17] : tables[18]],
            tables[tables[18] : tables[19]],
        )  # fmt: skip
        many = np.int32(len(lists.reach))
        coarse = Coarse(
            centres, band, unknowns[:many], unknowns[many : 2 * many], unknowns[2 * many : 3 * many],
            np.int32(band.size // max(many, one_sum)),
        )  # fmt: skip
        particles, tetrahedra = np.int32(size // quad), np.int32(len(lists.materials))
        groups, element_groups = (
            np.int32((particles + summed - 1) // summed),
            np.int32((tetrahedra + summed - 1) // summed),
        )
        element_units, alone = np.int32((tetrahedra + unit_size - 1) // unit_size), np.int32(len(lists.bodies) - 1)
        block, wanted, turn, half = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x), 0, sums.size // 2
        first_thread = block == 0 and cuda.threadIdx.x == 0
        for number in range(steps * substeps):
            step = np.int64(0)
            if has_time:
                step = counter[0] + number // substeps
            time = step, step * substeps + number % substeps
            kind, counts = BEGIN, (0, 0, 0, 0, 0)
            kept = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
            while True:
                parts_of = sums[turn * half : (turn + 1) * half]
                if kind in (LOOK, BLOCKS, DAMPER_BLOCKS):
                    for unit in range(block, element_units, cuda.gridDim.x):
                        of_elements(kind, unit, tetrahedra, v, matrix, lists, values, counts[1], shared, parts_of)
                elif kind in (CENTRES, COARSE, RESTRICT, FACTOR, BACK):
                    coarse_pass(kind, v, matrix, lists, coarse, shared, parts_of)
                else:
                    shares = kept[5], kept[6], kept[7]
                    for group in range(block, groups, cuda.gridDim.x):
                        of_particles(
                            kind, group, particles, v, matrix, lists, coarse, world, time, shares, shared, parts_of
                        )
                wanted = meet(flags, wanted)
                if kind == FINISH:
                    break
                if kind in (COARSE, RESTRICT):
                    kind = FACTOR if kind == COARSE else BACK
                    continue
                first, second = zero, zero
                if kind == LOOK:
                    total(shared, two_sums, element_groups, parts_of)
                    first, second = shared[0], shared[1]
                elif kind in (WEIGH, ROWS, PRODUCT, CORRECT, MOVE):
                    total(shared, one_sum, groups, parts_of)
                    first = shared[0]
                elif kind == FACTOR:
                    total(shared, one_sum, alone, parts_of)
                    first = shared[0]
                cuda.syncthreads()
                if first_thread:
                    if kind == LOOK:
                        done[1] += 1
                    elif kind == ROWS:
                        done[2] += 1
                    elif kind == PRODUCT:
                        done[3] += 1
                if kind == FACTOR:
                    kind = COARSE
                elif kind == BACK:
                    kind = RESTRICT
                kind, counts, kept = after(kind, counts, kept, first, second, iterations, damped, floor)
                turn = 1 - turn
            if first_thread:
                done[0] += 1
                done[4] += counts[3]

    variant = variant_name(real, math, parts)
    return make_kernel(newton_steps, f"newton_{variant}", launch_bounds=(THREADS, 1), **kernel_options(math))
