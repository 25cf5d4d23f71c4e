"""Conjugate gradients on tetrahedra in `fast` math, on CUDA: three passes per iteration, and no unknown waits for
another.

The coarse matrix is inverted once its factor is known, one team per column: applying the inverse has no sequential
steps, of which substitution has two per unknown. A block processes a group of the coarse level and does everything with
its particles that does not depend on others: they are updated and restricted in one pass, and get the corrections of
both levels in another. The new direction is computed where the matrix is applied to it, by each row for itself, from
the old one: two alternating arrays.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_coarse import NO_MOMENTS, arm_of
from softlab.gpu_backend.tetrahedra.newton_elements import load_block, load_six
from softlab.gpu_backend.tetrahedra.newton_sums import TEAM, of_block, of_four, of_team, put, slots, synchronize_team
from softlab.model.base.variant import inlined_routine, unrolled
from softlab.model.formulas.elastic.coarse import moment, motion
from softlab.model.formulas.elastic.deformation import times
from softlab.model.formulas.elastic.newton import moved
from softlab.model.formulas.elastic.solving import dot, preconditioned
from softlab.model.tetrahedra.aggregates import MODES, MOST
from softlab.model.tetrahedra.newton import SUMMED


@inlined_routine
def residual_of(begins, k, particles, v, latest, alpha):
    """Return the residual of particle k (three numbers), at a solve's start or after a step along the direction."""
    if begins:
        g = load_quad(v.gradient, k)
        x, y, z = -g[0], -g[1], -g[2]
        store_quad(v.solution, k, 0.0, 0.0, 0.0, 0.0)
        store_quad(v.direction, k, 0.0, 0.0, 0.0, 0.0)
        store_quad(v.direction, particles + k, 0.0, 0.0, 0.0, 0.0)
    else:
        d, q = load_quad(v.direction, latest * particles + k), load_quad(v.product, k)
        s, r = load_quad(v.solution, k), load_quad(v.residual, k)
        store_quad(v.solution, k, moved(s[0], alpha, d[0]), moved(s[1], alpha, d[1]), moved(s[2], alpha, d[2]), 0.0)
        x, y, z = moved(r[0], -alpha, q[0]), moved(r[1], -alpha, q[1]), moved(r[2], -alpha, q[2])
    store_quad(v.residual, k, x, y, z, 0.0)
    return x, y, z


@inlined_routine
def advance(begins, group, particles, solver, latest, alpha, shared):
    """Write the residual of a group's particles and its restriction, for a block, at a solve's start (`begins`) or after a
    step along the direction `latest` of the two."""
    v, coarse = solver.vectors, solver.coarse
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    sums = NO_MOMENTS
    for n in range(solver.groups.starts[group] + t, solver.groups.starts[group + 1], threads):
        k = solver.groups.members[n]
        x, y, z = residual_of(begins, k, particles, v, latest, alpha)
        moments = moment(arm_of(k, group, v, coarse), x, y, z)
        sums = tuple(sums[mode] + moments[mode] for mode in unrolled(MODES))
    cuda.syncthreads()
    for mode in unrolled(MODES):
        put(shared, np.int32(mode), sums[mode])
    cuda.syncthreads()
    if t < MODES:
        coarse.solved[MODES * group + t] = slots(shared, t)
    cuda.syncthreads()


@inlined_routine
def correct(group, particles, solver, shared, parts):
    """Write the preconditioned residual of a group's particles, for a block."""
    v, coarse = solver.vectors, solver.coarse
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    body = solver.pairs.body_of[group]
    first = np.int32(MODES * solver.pairs.bodies[body])
    size, place = np.int32(MODES * solver.pairs.bodies[body + 1] - first), solver.pairs.places[body]
    cuda.syncthreads()
    for i in range(t // TEAM, MODES, threads // TEAM):
        running, row = 0.0, np.int32(place + (MODES * group - first + i) * size)
        for j in range(t % TEAM, size, TEAM):
            running = running + coarse.inverse[row + j] * coarse.solved[first + j]
        running = of_team(shared, running)
        if t % TEAM == 0:
            shared[i] = running
    cuda.syncthreads()
    y, total = load_six(shared, np.int32(0), np.int32(1)), 0.0
    for n in range(solver.groups.starts[group] + t, solver.groups.starts[group + 1], threads):
        k = solver.groups.members[n]
        r = load_quad(v.residual, k)
        x, y_block, z = preconditioned(load_six(solver.matrix.inverses, k, particles), r[0], r[1], r[2])
        p, q, s = motion(arm_of(k, group, v, coarse), y)
        x, y_block, z = x + p, y_block + q, z + s
        store_quad(v.preconditioned, k, x, y_block, z, 0.0)
        total = total + dot(r[0], r[1], r[2], x, y_block, z)
    total = of_block(shared, np.int32(0), total)
    if t == 0:
        parts[group] = total
    cuda.syncthreads()


@inlined_routine
def direction_of(k, particles, v, latest, beta):
    z, d = load_quad(v.preconditioned, k), load_quad(v.direction, latest * particles + k)
    return moved(z[0], beta, d[0]), moved(z[1], beta, d[1]), moved(z[2], beta, d[2])


@inlined_routine
def product(group, particles, solver, latest, beta, shared, parts):
    """Write the new direction of SUMMED particles and its product with the matrix, four threads per row; `latest`: which of
    the two directions is the old one."""
    v = solver.vectors
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    total = 0.0
    for one in range(t // 4, SUMMED, threads // 4):
        k, x, y, z = np.int32(group * SUMMED + one), 0.0, 0.0, 0.0
        free = False
        if k < particles:
            free = solver.groups.group[k] >= 0
        if free:
            for n in range(solver.rows.starts[k] + t % 4, solver.rows.starts[k + 1], 4):
                d = direction_of(solver.rows.columns[n], particles, v, latest, beta)
                p, q, r = times(load_block(solver.matrix.blocks, n), d[0], d[1], d[2])
                x, y, z = x + p, y + q, z + r
        x, y, z = of_four(shared, x), of_four(shared, y), of_four(shared, z)
        if free and t % 4 == 0:
            d = direction_of(k, particles, v, latest, beta)
            store_quad(v.direction, (1 - latest) * particles + k, d[0], d[1], d[2], 0.0)
            store_quad(v.product, k, x, y, z, 0.0)
            total = total + dot(d[0], d[1], d[2], x, y, z)
    total = of_block(shared, np.int32(0), total)
    if t == 0:
        parts[group] = total
    cuda.syncthreads()


@inlined_routine
def above(i, k, first, solver):
    """Return row i's entry in column k."""
    coarse, entry = solver.coarse, 0.0
    if i >= first:
        if solver.groups.last_column[i] >= k:
            entry = coarse.band[i * coarse.width + k - i]
    return entry


@inlined_routine
def invert(column, solver, shared):
    """Write one column of the inverse of a body's coarse matrix, for a team; data of the next row is loaded while one is
    processed."""
    coarse = solver.coarse
    t = np.int32(cuda.threadIdx.x)
    lane, base = np.int32(t % TEAM), np.int32(t // TEAM * (MODES * MOST))
    band, width, body = coarse.band, coarse.width, solver.pairs.body_of[column // MODES]
    first, last = np.int32(MODES * solver.pairs.bodies[body]), np.int32(MODES * solver.pairs.bodies[body + 1])
    size, x = np.int32(last - first), np.int32(base - first)
    synchronize_team()
    for k in range(first + lane, last, TEAM):
        shared[x + k] = 1.0 if k == column else 0.0
    synchronize_team()
    entry, pivot = band[column * width + min(lane + 1, width - 1)], coarse.pivots[column]
    many = np.int32(solver.groups.last_column[column] - column)
    for k in range(column, last):
        now, here, reached = entry, pivot, many
        if k + 1 < last:
            entry = band[(k + 1) * width + min(lane + 1, width - 1)]
            pivot, many = coarse.pivots[k + 1], np.int32(solver.groups.last_column[k + 1] - (k + 1))
        y = here * shared[x + k]
        if lane < reached:
            shared[x + k + 1 + lane] -= y * now
        for j in range(lane + 1 + TEAM, reached + 1, TEAM):
            shared[x + k + j] -= y * band[k * width + j]
        synchronize_team()
        if lane == np.int32(0):
            shared[x + k] = y
    synchronize_team()
    entry, pivot = above(np.int32(last - 2 - lane), last - 1, first, solver), coarse.pivots[last - 1]
    for n in range(size):
        k, now, here = np.int32(last - 1 - n), entry, pivot
        i = np.int32(k - 1 - lane)
        if k > first:
            entry, pivot = above(np.int32(i - 1), k - 1, first, solver), coarse.pivots[k - 1]
        y = here * shared[x + k]
        if i >= first:
            shared[x + i] -= y * now
        i = np.int32(i - TEAM)
        while i >= first and solver.groups.last_column[i] >= k:
            shared[x + i] -= y * band[i * width + k - i]
            i = np.int32(i - TEAM)
        synchronize_team()
        if lane == np.int32(0):
            shared[x + k] = y
    synchronize_team()
    place = np.int32(solver.pairs.places[body] + (column - first) * size)
    for k in range(first + lane, last, TEAM):
        coarse.inverse[place + k - first] = shared[x + k]
    synchronize_team()
