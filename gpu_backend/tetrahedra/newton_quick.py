"""Conjugate gradients on tetrahedra in `fast` math, on CUDA: three passes per iteration, and no unknown waits for
another.

The coarse matrix is inverted once its factor is known, one team per column: applying the inverse has no sequential
steps, of which substitution has two per unknown. A block processes a group of the coarse level and does everything with
its particles that does not depend on others: they are updated and restricted in one pass, and get the corrections of
both levels in another. The new direction is computed where the matrix is applied to it, by each row for itself, from
the old one: two alternating arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_coarse import make_arm
from softlab.gpu_backend.tetrahedra.newton_elements import make_block_access
from softlab.gpu_backend.tetrahedra.newton_sums import TEAM, make_quick_sums, make_sums
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import coarse as formulas_of
from softlab.model.formulas.elastic import descent, newton, solving
from softlab.model.formulas.elastic.newton import SOLVE
from softlab.model.tetrahedra.aggregates import MODES, MOST
from softlab.model.tetrahedra.newton import SUMMED


@cache
def make_residual(real: Real, math: str) -> Callable:
    """Make residual_of(kind, k, particles, v, flip, alpha): the residual of particle k (three numbers), at a solve's
    start or after a step along the direction."""
    moved, zero = device_formulas(newton, real, math).moved, real(0)

    @inlined(math)
    def residual_of(kind, k, particles, v, flip, alpha):
        if kind == SOLVE:
            g = load_quad(v.gradient, k)
            x, y, z = -g[0], -g[1], -g[2]
            store_quad(v.solution, k, zero, zero, zero, zero)
            store_quad(v.direction, k, zero, zero, zero, zero)
            store_quad(v.direction, particles + k, zero, zero, zero, zero)
        else:
            d, q = load_quad(v.direction, flip * particles + k), load_quad(v.product, k)
            s, r = load_quad(v.solution, k), load_quad(v.residual, k)
            store_quad(
                v.solution, k, moved(s[0], alpha, d[0]), moved(s[1], alpha, d[1]), moved(s[2], alpha, d[2]), zero
            )
            x, y, z = moved(r[0], -alpha, q[0]), moved(r[1], -alpha, q[1]), moved(r[2], -alpha, q[2])
        store_quad(v.residual, k, x, y, z, zero)
        return x, y, z

    return residual_of


@cache
def make_quick_groups(real: Real, math: str) -> SimpleNamespace:
    """Make `advance(kind, group, particles, solver, flip, alpha, shared)`, the residual of the group's
    particles and its restriction, and `correct(group, particles, solver, shared, parts)`, the
    preconditioned residual. `flip`: which of the two directions is the last one."""
    inline, formulas = inlined(math), device_formulas(formulas_of, real, math)
    moment, motion = formulas.moment, formulas.motion
    products, residual_of, arm_of = (
        device_formulas(solving, real, math),
        make_residual(real, math),
        make_arm(real, math),
    )
    preconditioned, dot = products.preconditioned, products.dot
    quick, zero, next_one, modes, team = (
        make_quick_sums(real, math),
        real(0),
        np.int32(1),
        np.int32(MODES),
        np.int32(TEAM),
    )
    none, load_six = np.int32(0), make_block_access(math).load_six
    put, slots, of_team, of_block = quick.put, quick.slots, quick.of_team, quick.of_block

    @inline
    def advance(kind, group, particles, solver, flip, alpha, shared):
        v, coarse = solver.vectors, solver.coarse
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        a, b, c, d, e, f = zero, zero, zero, zero, zero, zero
        for n in range(solver.groups.starts[group] + t, solver.groups.starts[group + next_one], threads):
            k = solver.groups.members[n]
            x, y, z = residual_of(kind, k, particles, v, flip, alpha)
            p, q, r, s, u, w = moment(arm_of(k, group, v, coarse), x, y, z)
            a, b, c, d, e, f = a + p, b + q, c + r, d + s, e + u, f + w
        cuda.syncthreads()
        put(shared, np.int32(0), a)
        put(shared, np.int32(1), b)
        put(shared, np.int32(2), c)
        put(shared, np.int32(3), d)
        put(shared, np.int32(4), e)
        put(shared, np.int32(5), f)
        cuda.syncthreads()
        if t < modes:
            coarse.solved[modes * group + t] = slots(shared, t)
        cuda.syncthreads()

    @inline
    def correct(group, particles, solver, shared, parts):
        v, coarse = solver.vectors, solver.coarse
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        body = solver.pairs.body_of[group]
        first = np.int32(modes * solver.pairs.bodies[body])
        size, place = np.int32(modes * solver.pairs.bodies[body + next_one] - first), solver.pairs.places[body]
        cuda.syncthreads()
        for i in range(t // team, modes, threads // team):
            running, row = zero, np.int32(place + (modes * group - first + i) * size)
            for j in range(t % team, size, team):
                running = running + coarse.inverse[row + j] * coarse.solved[first + j]
            running = of_team(shared, running)
            if t % team == 0:
                shared[i] = running
        cuda.syncthreads()
        y, total = load_six(shared, none, next_one), zero
        for n in range(solver.groups.starts[group] + t, solver.groups.starts[group + next_one], threads):
            k = solver.groups.members[n]
            r = load_quad(v.residual, k)
            x, y_block, z = preconditioned(load_six(solver.matrix.inverses, k, particles), r[0], r[1], r[2])
            p, q, s = motion(arm_of(k, group, v, coarse), y)
            x, y_block, z = x + p, y_block + q, z + s
            store_quad(v.better, k, x, y_block, z, zero)
            total = total + dot(r[0], r[1], r[2], x, y_block, z)
        total = of_block(shared, np.int32(0), total)
        if t == 0:
            parts[group] = total
        cuda.syncthreads()

    return SimpleNamespace(advance=advance, correct=correct)


@cache
def make_quick_product(real: Real, math: str) -> Callable:
    """Make product(group, particles, solver, flip, beta, shared, parts): for SUMMED particles, the new
    direction and its product with the matrix, four threads per row; `flip`: which of the two directions is the old
    one."""
    inline, quick = inlined(math), make_quick_sums(real, math)
    of_four, of_block, load_block = quick.of_four, quick.of_block, make_block_access(math).load_block
    products, moved = device_formulas(solving, real, math), device_formulas(newton, real, math).moved
    applied, dot, zero, next_one = device_formulas(descent, real, math).times, products.dot, real(0), np.int32(1)
    summed, four = np.int32(SUMMED), np.int32(4)

    @inline
    def direction_of(k, particles, v, flip, beta):
        z, d = load_quad(v.better, k), load_quad(v.direction, flip * particles + k)
        return moved(z[0], beta, d[0]), moved(z[1], beta, d[1]), moved(z[2], beta, d[2])

    @inline
    def product(group, particles, solver, flip, beta, shared, parts):
        v = solver.vectors
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        total = zero
        for one in range(t // four, summed, threads // four):
            k, x, y, z = np.int32(group * summed + one), zero, zero, zero
            free = False
            if k < particles:
                free = solver.groups.group[k] >= 0
            if free:
                for n in range(solver.rows.starts[k] + t % four, solver.rows.starts[k + next_one], four):
                    d = direction_of(solver.rows.columns[n], particles, v, flip, beta)
                    p, q, r = applied(load_block(solver.matrix.blocks, n), d[0], d[1], d[2])
                    x, y, z = x + p, y + q, z + r
            x, y, z = of_four(shared, x), of_four(shared, y), of_four(shared, z)
            if free and t % four == 0:
                d = direction_of(k, particles, v, flip, beta)
                store_quad(v.direction, (next_one - flip) * particles + k, d[0], d[1], d[2], zero)
                store_quad(v.product, k, x, y, z, zero)
                total = total + dot(d[0], d[1], d[2], x, y, z)
        total = of_block(shared, np.int32(0), total)
        if t == 0:
            parts[group] = total
        cuda.syncthreads()

    return product


@cache
def make_invert(real: Real, math: str) -> Callable:
    """Make invert(column, solver, shared): for a team, one column of the inverse of a body's coarse matrix; data
    of the next row is loaded while one is processed."""
    inline, synchronize_team, zero, one = inlined(math), make_sums(real, math).synchronize_team, real(0), real(1)
    team, modes, next_one, none, capacity = (
        np.int32(TEAM),
        np.int32(MODES),
        np.int32(1),
        np.int32(0),
        np.int32(MODES * MOST),
    )

    @inline
    def above(i, k, first, solver):
        """Return row i's entry in column k."""
        coarse, entry = solver.coarse, zero
        if i >= first:
            if solver.groups.reach[i] >= k:
                entry = coarse.band[i * coarse.width + k - i]
        return entry

    @inline
    def invert(column, solver, shared):
        coarse = solver.coarse
        t = np.int32(cuda.threadIdx.x)
        lane, base = np.int32(t % team), np.int32(t // team * capacity)
        band, width, body = coarse.band, coarse.width, solver.pairs.body_of[column // modes]
        first, last = (
            np.int32(modes * solver.pairs.bodies[body]),
            np.int32(modes * solver.pairs.bodies[body + next_one]),
        )
        size, x = np.int32(last - first), np.int32(base - first)
        synchronize_team()
        for k in range(first + lane, last, team):
            shared[x + k] = one if k == column else zero
        synchronize_team()
        entry, pivot = band[column * width + min(lane + next_one, width - next_one)], coarse.pivots[column]
        many = np.int32(solver.groups.reach[column] - column)
        for k in range(column, last):
            now, here, reached = entry, pivot, many
            if k + 1 < last:
                entry = band[(k + 1) * width + min(lane + next_one, width - next_one)]
                pivot, many = coarse.pivots[k + 1], np.int32(solver.groups.reach[k + 1] - (k + 1))
            y = here * shared[x + k]
            if lane < reached:
                shared[x + k + 1 + lane] -= y * now
            for j in range(lane + next_one + team, reached + next_one, team):
                shared[x + k + j] -= y * band[k * width + j]
            synchronize_team()
            if lane == none:
                shared[x + k] = y
        synchronize_team()
        entry, pivot = (
            above(np.int32(last - 2 - lane), last - next_one, first, solver),
            coarse.pivots[last - next_one],
        )
        for n in range(size):
            k, now, here = np.int32(last - next_one - n), entry, pivot
            i = np.int32(k - next_one - lane)
            if k > first:
                entry, pivot = (
                    above(np.int32(i - next_one), k - next_one, first, solver),
                    coarse.pivots[k - next_one],
                )
            y = here * shared[x + k]
            if i >= first:
                shared[x + i] -= y * now
            i = np.int32(i - team)
            while i >= first and solver.groups.reach[i] >= k:
                shared[x + i] -= y * band[i * width + k - i]
                i = np.int32(i - team)
            synchronize_team()
            if lane == none:
                shared[x + k] = y
        synchronize_team()
        place = np.int32(solver.pairs.places[body] + (column - first) * size)
        for k in range(first + lane, last, team):
            coarse.inverse[place + k - first] = shared[x + k]
        synchronize_team()

    return invert
