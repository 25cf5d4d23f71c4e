"""The kernel of implicit tetrahedral bodies on CUDA: blocks that run the passes together, for whole steps.

model/formulas/elastic/newton.py has the passes and their order. Blocks are launched together and synchronise after
every pass. The next pass depends on sums over all blocks: each block computes them from the sums of groups, in the
CPU's order, so that all make the same decision, and in `exact` math get the CPU's bits. The sums of groups alternate
between two buffers, since a fast block begins the next pass while a slow one still reads them.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.forces import particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.meeting import barrier
from softlab.gpu_backend.core.quads import SIZE, load_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.tetrahedra.newton_arrays import Time
from softlab.gpu_backend.tetrahedra.newton_coarse import centre, couple, factor, restrict, solve
from softlab.gpu_backend.tetrahedra.newton_elements import blocks, energies
from softlab.gpu_backend.tetrahedra.newton_quick import advance, correct, invert, product
from softlab.gpu_backend.tetrahedra.newton_rows import (
    accept,
    assemble,
    begin_solve,
    move,
    multiply,
    precondition,
    put,
    settle_row,
    turn,
    update,
    weigh,
)
from softlab.gpu_backend.tetrahedra.newton_substep import begin, finish
from softlab.gpu_backend.tetrahedra.newton_sums import CAPACITY, TEAM, THREADS, UNIT, add_groups, total
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, real, routine
from softlab.model.contact.sheet_plan import FRICTION_IN_PLACE
from softlab.model.formulas.elastic import newton
from softlab.model.formulas.elastic.newton import DONE, PASS, Counts, Values
from softlab.model.tetrahedra.aggregates import MODES
from softlab.model.tetrahedra.newton import SUMMED
from softlab.model.tetrahedra.springs import kernel_features

after = Open("after(...), of model/formulas/elastic/newton.py, in exact math")


@inlined_routine
def element_pass(kind, solver, world, number, safe, shared, sums):
    """Run a pass over tetrahedra, UNIT per block at a time."""
    block, blocks_of_grid = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    t, threads, rate = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x), world.parameters.newton_rate
    count = np.int32(len(solver.elements.materials))
    for unit in range(block, (count + UNIT - 1) // UNIT, blocks_of_grid):
        for one in range(t, np.int32(UNIT), threads):
            n = np.int32(unit * UNIT + one)
            energy, unsure = 0.0, 0.0
            if n < count:
                if kind == PASS.ENERGIES:
                    energy, unsure = energies(n, count, solver, rate, number)
                else:
                    blocks(n, count, solver, rate, number, safe != 0)
            shared[one], shared[UNIT + one] = energy, unsure
        if kind == PASS.ENERGIES:
            groups = np.int32((count + SUMMED - 1) // SUMMED)
            width = np.int32(min(np.int32(UNIT), np.int32(count - unit * UNIT)))
            add_groups(shared, np.int32(2), width, np.int32(unit * UNIT // SUMMED), groups, sums)


@inlined_routine
def visit(kind, k, particles, solver, world, time, values):
    """Do particle k's part of a pass. Returns its summand."""
    v, total = solver.vectors, 0.0
    if kind == PASS.BEGIN:
        begin(k, solver, world, time)
    elif kind == PASS.FINISH:
        finish(k, solver, world, time.number)
    elif kind == PASS.ROWS:
        total = settle_row(k, particles, solver, world, time.number)
    elif load_quad(v.before, k)[3] != 0.0:
        if kind == PASS.WEIGH:
            total = weigh(k, solver, world, time.number)
        elif kind == PASS.ACCEPT:
            accept(k, v)
        elif kind == PASS.RETURN:
            put(k, v, v.current)
        elif kind == PASS.AHEAD:
            put(k, v, v.target)
        elif kind == PASS.MOVE:
            total = move(k, v, values.fraction)
        elif not FEATURE.fast:
            if kind == PASS.SOLVE:
                begin_solve(k, v)
            elif kind == PASS.PRODUCT:
                total = multiply(k, solver.rows, solver.matrix.blocks, v)
            elif kind == PASS.UPDATE:
                update(k, v, values.alpha)
            elif kind == PASS.CORRECT:
                total = precondition(k, particles, solver)
            elif kind == PASS.DIRECTION:
                turn(k, v, values.beta)
    return total


@inlined_routine
def particle_pass(kind, solver, world, time, values, shared, sums):
    """Run a pass over particles, SUMMED per block at a time."""
    block, blocks_of_grid = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    particles = np.int32(solver.vectors.position.size // SIZE)
    groups = np.int32((particles + SUMMED - 1) // SUMMED)
    for group in range(block, groups, blocks_of_grid):
        if kind == PASS.ROWS:
            assemble(group, particles, solver.rows, solver.matrix)
        for one in range(t, np.int32(SUMMED), threads):
            k, summand = np.int32(group * SUMMED + one), 0.0
            if k < particles:
                summand = visit(kind, k, particles, solver, world, time, values)
            shared[one] = summand
        if kind in (PASS.WEIGH, PASS.ROWS, PASS.PRODUCT, PASS.CORRECT, PASS.MOVE):
            add_groups(shared, np.int32(1), np.int32(SUMMED), group, groups, sums)


@inlined_routine
def coarse_pass(kind, solver, shared, sums):
    """Run a pass over groups of particles, a team of threads each; over pairs of groups or bodies, a block each."""
    block, blocks_of_grid = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    t, teams = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x // TEAM)
    first_team, all_teams = np.int32(block * teams + t // TEAM), np.int32(blocks_of_grid * teams)
    groups, bodies = len(solver.groups.starts) - 1, len(solver.pairs.bodies) - 1
    if kind == PASS.CENTRES:
        for group in range(first_team, groups, all_teams):
            centre(group, solver, shared)
    elif kind == PASS.COARSE:
        for pair in range(block, len(solver.pairs.starts) - 1, blocks_of_grid):
            couple(pair, solver, shared)
    elif kind == PASS.FACTOR:
        for body in range(block, bodies, blocks_of_grid):
            bad = factor(body, solver)
            if t == 0:
                sums[body] = bad
    elif not FEATURE.fast:
        if kind == PASS.RESTRICT:
            for group in range(first_team, groups, all_teams):
                restrict(group, solver, shared)
        elif kind == PASS.SUBSTITUTE:
            for body in range(first_team, bodies, all_teams):
                solve(body, solver, shared)


@inlined_routine
def quick_pass(kind, solver, latest, values, shared, sums):
    """Run a pass of conjugate gradients in `fast` math (newton_quick.py).

    `solve`, which inverts the coarse matrix, and `update` restrict the residual, too; `product` begins with the new
    direction; `correct` solves the coarse system. `latest`: which of the two directions is the last one.
    """
    block, blocks_of_grid = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    particles = np.int32(solver.vectors.position.size // SIZE)
    groups = len(solver.groups.starts) - 1
    if kind == PASS.PRODUCT:
        for group in range(block, (particles + SUMMED - 1) // SUMMED, blocks_of_grid):
            product(group, particles, solver, latest, values.beta, shared, sums)
    elif kind == PASS.CORRECT:
        for group in range(block, groups, blocks_of_grid):
            correct(group, particles, solver, shared, sums)
    else:
        if kind == PASS.SOLVE:
            teams = np.int32(cuda.blockDim.x // TEAM)
            first_team = np.int32(block * teams + np.int32(cuda.threadIdx.x) // TEAM)
            for column in range(first_team, MODES * groups, blocks_of_grid * teams):
                invert(column, solver, shared)
        for group in range(block, groups, blocks_of_grid):
            advance(kind == PASS.SOLVE, group, particles, solver, latest, values.alpha, shared)


@inlined_routine
def sums_of(kind, solver, shared, sums):
    """Return the two sums of a pass over all blocks, 0 if it has none."""
    first, second, count = 0.0, 0.0, np.int32(0)
    if kind == PASS.ENERGIES:
        count = np.int32((len(solver.elements.materials) + SUMMED - 1) // SUMMED)
    elif kind == PASS.FACTOR:
        count = np.int32(len(solver.pairs.bodies) - 1)
    elif FEATURE.fast and kind == PASS.CORRECT:
        count = np.int32(len(solver.groups.starts) - 1)
    elif kind in (PASS.WEIGH, PASS.ROWS, PASS.PRODUCT, PASS.CORRECT, PASS.MOVE):
        count = np.int32((solver.vectors.position.size // SIZE + SUMMED - 1) // SUMMED)
    if count > 0:
        total(shared, np.int32(2) if kind == PASS.ENERGIES else np.int32(1), count, sums)
        first = shared[0]
        if kind == PASS.ENERGIES:
            second = shared[1]
    cuda.syncthreads()
    return first, second


@inlined_routine
def count_pass(kind, counts, done):
    """Count a pass, for one thread of all."""
    if kind == PASS.ENERGIES:
        done[DONE.EVALUATIONS] += 1
    elif kind == PASS.ROWS:
        done[DONE.MATRICES] += 1
    elif kind == PASS.PRODUCT:
        done[DONE.PRODUCTS] += 1
    elif kind == PASS.FINISH:
        done[DONE.SOLVES] += 1
        done[DONE.STEPS] += counts.steps


@routine
def newton_steps(solver, record, colliders, integers, counter, control, limits):
    """Advance the state in `solver.vectors` by `limits.steps` steps; newton_arrays.py describes the arguments."""
    shared = cuda.shared.array(CAPACITY, real)
    world = World(record[0], colliders, integers)
    arrivals, buffer, latest, half = np.int32(cuda.gridDim.x), 0, 0, control.sums.size // 2
    for number in range(limits.steps * limits.solves):
        step = np.int64(0)
        if FEATURE.timed:
            step = counter[0] + number // limits.solves
        time = Time(step, step * limits.solves + number % limits.solves)
        kind, counts = PASS.BEGIN, Counts(np.int64(0), np.int64(0), np.int64(0), np.int64(0), np.int64(0))
        values = Values(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        while True:
            sums = control.sums[buffer * half : (buffer + 1) * half]
            if kind in (PASS.ENERGIES, PASS.BLOCKS):
                element_pass(kind, solver, world, time.number, counts.safe, shared, sums)
            elif kind in (PASS.CENTRES, PASS.COARSE, PASS.FACTOR, PASS.RESTRICT, PASS.SUBSTITUTE):
                coarse_pass(kind, solver, shared, sums)
            elif FEATURE.fast and kind in (PASS.SOLVE, PASS.PRODUCT, PASS.UPDATE, PASS.CORRECT):
                quick_pass(kind, solver, latest, values, shared, sums)
            else:
                particle_pass(kind, solver, world, time, values, shared, sums)
            arrivals = barrier(control.flags, arrivals)
            if cuda.blockIdx.x == 0 and cuda.threadIdx.x == 0:
                count_pass(kind, counts, control.done)
            if kind == PASS.FINISH:
                break
            first, second = sums_of(kind, solver, shared, sums)
            if kind == PASS.PRODUCT:
                latest = 1 - latest
            kind, counts, values = after(kind, counts, values, first, second, limits.iterations, limits.floor)
            if FEATURE.fast:  # done with the last pass, or with the next one
                if kind == PASS.RESTRICT:
                    kind = PASS.CORRECT
                elif kind == PASS.DIRECTION:
                    kind = PASS.PRODUCT
            buffer = 1 - buffer


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
