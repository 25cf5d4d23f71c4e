"""The passes of implicit Euler on tetrahedra, on CUDA: over units of tetrahedra, groups of particles, the coarse
level."""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide, predict, rate_of
from softlab.gpu_backend.core.forces import add_gravity, add_particle_force
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_coarse import centre, corrected, couple, factor, restrict
from softlab.gpu_backend.tetrahedra.newton_coarse import solve as solve_body
from softlab.gpu_backend.tetrahedra.newton_contact import pressed
from softlab.gpu_backend.tetrahedra.newton_elements import blocks, energies, store_block
from softlab.gpu_backend.tetrahedra.newton_pins import driven
from softlab.gpu_backend.tetrahedra.newton_quick import advance, correct, invert, product
from softlab.gpu_backend.tetrahedra.newton_rows import block_of, move, settle_row, solve, weigh
from softlab.gpu_backend.tetrahedra.newton_sums import TEAM, UNIT, add_groups
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.formulas.distance import slowed
from softlab.model.formulas.elastic.newton import (
    BEGIN,
    CENTRES,
    COARSE,
    CORRECT,
    DIRECTION,
    ENERGIES,
    FINISH,
    KINDS,
    MOVE,
    PRODUCT,
    RESTRICT,
    ROWS,
    UPDATE,
    WEIGH,
)
from softlab.model.formulas.elastic.stages import ahead
from softlab.model.tetrahedra.newton import SUMMED

FACTOR, INVERT, BACK = range(len(KINDS), len(KINDS) + 3)  # passes after `coarse rows` and `restrict`, before the next


@inlined_routine
def begin_stage(k, p, w, v, h, number):
    """Start a stage, as on the CPU (cpu_backend/tetrahedra/newton_steps.py)."""
    if FEATURE.damped:
        store_quad(v.origin if number % 2 == 0 else v.middle, k, p[0], p[1], p[2], 0.0)
    if number % 2 == 0:
        store_quad(v.start, k, w[0], w[1], w[2], 0.0)
    elif p[3] != 0.0:
        s = load_quad(v.start, k)
        (x, vx), (y, vy), (z, vz) = ahead(p[0], w[0], s[0], h), ahead(p[1], w[1], s[1], h), ahead(p[2], w[2], s[2], h)
        p, w = (x, y, z, p[3]), (vx, vy, vz, w[3])
        store_quad(v.position, k, x, y, z, p[3])
    return p, w


@inlined_routine
def begin(k, solver, world, time):
    """Write the inertial or driven position of particle k."""
    v = solver.vectors
    p, w = load_quad(v.position, k), load_quad(v.velocity, k)
    if FEATURE.two_stages:
        p, w = begin_stage(k, p, w, v, world.parameters.dt, time[1])
    ax, ay, az = add_gravity(0.0, 0.0, 0.0, world.parameters)
    ax, ay, az = add_particle_force(ax, ay, az, k, p[3], world.parameters, world.integers, time[0])
    if FEATURE.body_damping:
        h = world.parameters.dt
        w = slowed(w[0], w[3], h), slowed(w[1], w[3], h), slowed(w[2], w[3], h), w[3]
    x, y, z = predict(p, w, ax, ay, az, world.parameters)
    store_quad(v.before, k, p[0], p[1], p[2], p[3])
    if FEATURE.motion:
        if p[3] == 0.0:
            x, y, z, _, _, _ = driven(k, p, solver.pins, world, time[1])
            store_quad(v.position, k, x, y, z, p[3])
    store_quad(v.target, k, x, y, z, p[3])


@inlined_routine
def finish(k, solver, world, number):
    """Write the velocity of particle k after colliders and motions."""
    v = solver.vectors
    b, p, rate = load_quad(v.before, k), load_quad(v.position, k), 0.0
    x, y, z = p[0], p[1], p[2]
    vx, vy, vz = 0.0, 0.0, 0.0
    if FEATURE.motion:
        if b[3] == 0.0:
            x, y, z, vx, vy, vz = driven(k, p, solver.pins, world, number)
    if b[3] != 0.0:
        vx, vy, vz = rate_of(p, b, world.parameters)
        if FEATURE.colliders:
            vx, vy, vz = pressed(b, p, (vx, vy, vz), solver.matrix.stiffness[k], world, number)
            x, y, z, vx, vy, vz = collide(b, p, vx, vy, vz, world, number)
    store_quad(v.position, k, x, y, z, b[3])
    if FEATURE.body_damping:
        rate = load_quad(v.velocity, k)[3]
    store_quad(v.velocity, k, vx, vy, vz, rate)


@inlined_routine
def assemble(group, particles, solver):
    """Write the rows of SUMMED particles, the sums of the blocks of their tetrahedra, for a block."""
    rows, matrix = solver.rows, solver.matrix
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    first = np.int32(group * SUMMED)
    last = np.int32(min(np.int32(first + SUMMED), particles))
    for n in range(rows.starts[first] + t, rows.starts[last], threads):
        store_block(matrix.blocks, n, block_of(n, rows, matrix.element_blocks))
    cuda.syncthreads()


@inlined_routine
def of_elements(kind, unit, count, solver, world, number, safe, shared, sums):
    """Run a pass over UNIT tetrahedra, for a block, and write sums of groups to `sums`."""
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    rate = world.parameters.newton_rate
    for one in range(t, np.int32(UNIT), threads):
        n = np.int32(unit * UNIT + one)
        energy, unsure = 0.0, 0.0
        if n < count:
            if kind == ENERGIES:
                energy, unsure = energies(n, count, solver, rate, number)
            else:
                blocks(n, count, solver, rate, number, safe != 0)
        shared[one], shared[UNIT + one] = energy, unsure
    if kind == ENERGIES:
        groups = np.int32((count + SUMMED - 1) // SUMMED)
        width = np.int32(min(np.int32(UNIT), np.int32(count - unit * UNIT)))
        add_groups(shared, np.int32(2), width, np.int32(unit * UNIT // SUMMED), groups, sums)


@inlined_routine
def of_particles(kind, group, particles, solver, world, time, values, shared, sums):
    """Run a pass over SUMMED particles, for a block, and write sums of groups to `sums`."""
    t, threads, number = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x), time[1]
    v = solver.vectors
    if kind == ROWS:
        assemble(group, particles, solver)
    for one in range(t, np.int32(SUMMED), threads):
        k, total = np.int32(group * SUMMED + one), 0.0
        if k < particles:
            if kind == BEGIN:
                begin(k, solver, world, time)
            elif kind == FINISH:
                finish(k, solver, world, number)
            elif kind == ROWS:
                total = settle_row(k, particles, solver, world, number)
            elif load_quad(v.before, k)[3] != 0.0:
                if kind == WEIGH:
                    total = weigh(k, solver, world, number)
                elif not FEATURE.fast and kind in (PRODUCT, UPDATE, CORRECT, DIRECTION):
                    more = 0.0, 0.0, 0.0
                    if kind == CORRECT:
                        more = corrected(k, solver)
                    total = solve(kind, k, particles, solver, more, values.alpha, values.beta)
                else:
                    total = move(kind, k, v, values.share)
        shared[one] = total
    if kind in (WEIGH, ROWS, PRODUCT, CORRECT, MOVE):
        groups = np.int32((particles + SUMMED - 1) // SUMMED)
        add_groups(shared, np.int32(1), np.int32(SUMMED), group, groups, sums)


@inlined_routine
def coarse_pass(kind, solver, shared, sums):
    """Run a pass over groups, pairs of them, or bodies, for all blocks."""
    block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    t, teams = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x // TEAM)
    first_team = np.int32(block * teams + t // TEAM)
    if kind == COARSE:
        for pair in range(block, len(solver.pairs.first), blocks):
            couple(pair, solver, shared)
    elif kind == FACTOR:
        for body in range(block, len(solver.pairs.bodies) - 1, blocks):
            bad = factor(body, solver)
            if t == 0:
                sums[body] = bad
    elif kind == CENTRES:
        for group in range(first_team, len(solver.pairs.body_of), blocks * teams):
            centre(group, solver, shared)
    elif not FEATURE.fast:
        if kind == RESTRICT:
            for group in range(first_team, len(solver.pairs.body_of), blocks * teams):
                restrict(group, solver, shared)
        else:
            for body in range(first_team, len(solver.pairs.bodies) - 1, blocks * teams):
                solve_body(body, solver, shared)
    else:
        for column in range(first_team, len(solver.groups.reach), blocks * teams):
            invert(column, solver, shared)


@inlined_routine
def quick_pass(kind, particles, solver, flip, values, shared, sums):
    """Run a pass of conjugate gradients in fast math, for all blocks: `solve` and `update`, which also restrict, `product`
    with the new direction, `correct`."""
    block, blocks = np.int32(cuda.blockIdx.x), np.int32(cuda.gridDim.x)
    if kind == PRODUCT:
        for group in range(block, (particles + SUMMED - 1) // SUMMED, blocks):
            product(group, particles, solver, flip, values.beta, shared, sums)
    elif kind == CORRECT:
        for group in range(block, len(solver.pairs.body_of), blocks):
            correct(group, particles, solver, shared, sums)
    else:
        for group in range(block, len(solver.pairs.body_of), blocks):
            advance(kind, group, particles, solver, flip, values.alpha, shared)
