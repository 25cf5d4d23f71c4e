"""The coarse level of Newton's method on tetrahedra, on CUDA: the sums of cpu_backend/tetrahedra/newton_coarse.py.

A team processes a group of particles, or solves for a body; a block processes a pair of groups that the matrix couples,
or factors a body's matrix column by column. `shared` is a block's memory (newton_sums.py).
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
from softlab.gpu_backend.tetrahedra.newton_elements import make_block_access
from softlab.gpu_backend.tetrahedra.newton_sums import CAPACITY, TEAM, TEAMS, make_sums
from softlab.model.base.types import Real
from softlab.model.formulas.elastic import coarse as formulas_of
from softlab.model.formulas.elastic import newton, solving
from softlab.model.tetrahedra.aggregates import MODES, MOST

TILE = 64  # blocks of a pair of groups that are projected onto rigid motions at once
ENTRIES = MODES * MODES
assert max((TILE + 1) * ENTRIES, TEAMS * MODES * MOST, TEAMS * MODES * TEAM) <= CAPACITY


@cache
def make_arm(real: Real, math: str) -> Callable:
    """Make arm_of(k, group, v, coarse): the vector to particle k from the group's centre."""
    arm = device_formulas(formulas_of, real, math).arm

    @inlined(math)
    def arm_of(k, group, v, coarse):
        p, c = load_quad(v.position, k), load_quad(coarse.centres, group)
        return arm(p[0], p[1], p[2], c[0], c[1], c[2], c[3])

    return arm_of


@cache
def make_coarse(real: Real, math: str) -> SimpleNamespace:
    """Make `centre(group, solver, shared)`, `restrict(group, solver, shared)`, for a team, and `corrected(k,
    solver)`: three numbers to add at particle k."""
    inline, formulas = inlined(math), device_formulas(formulas_of, real, math)
    scale_of, arm, moment, motion = formulas.scale_of, formulas.arm, formulas.moment, formulas.motion
    dot, arm_of, sums = device_formulas(solving, real, math).dot, make_arm(real, math), make_sums(real, math)
    synchronize_team, add_team, load_six = sums.synchronize_team, sums.add_team, make_block_access(math).load_six
    zero, one, next_one, none = real(0), real(1), np.int32(1), np.int32(0)
    team, modes = np.int32(TEAM), np.int32(MODES)
    capacity, one_lane, three = np.int32(MODES * TEAM), np.int32(1), np.int32(3)

    @inline
    def place_of():
        """Return (lane, start of the team's part of the block's memory)."""
        t = np.int32(cuda.threadIdx.x)
        return np.int32(t % team), np.int32(t // team * capacity)

    @inline
    def centre(group, solver, shared):
        v, coarse = solver.vectors, solver.coarse
        lane, base = place_of()
        first, last = solver.groups.starts[group], solver.groups.starts[group + next_one]
        count, running = real(last - first), zero
        for begin in range(first, last, team):
            x, y, z = zero, zero, zero
            if begin + lane < last:
                p = load_quad(v.position, solver.groups.members[begin + lane])
                x, y, z = p[0], p[1], p[2]
            shared[base + lane], shared[base + team + lane], shared[base + 2 * team + lane] = x, y, z
            running = add_team(shared, base, three, lane, running)
        if lane < three:
            shared[base + lane] = running / count
        synchronize_team()
        cx, cy, cz = shared[base], shared[base + 1], shared[base + 2]
        synchronize_team()
        running = zero
        for begin in range(first, last, team):
            squared = zero
            if begin + lane < last:
                p = load_quad(v.position, solver.groups.members[begin + lane])
                p, q, r = arm(p[0], p[1], p[2], cx, cy, cz, one)
                squared = dot(p, q, r, p, q, r)
            shared[base + lane] = squared
            running = add_team(shared, base, one_lane, lane, running)
        if lane == none:
            store_quad(coarse.centres, group, cx, cy, cz, scale_of(running, count))
        width = coarse.width
        for n in range(lane, modes * width, team):
            coarse.band[modes * group * width + n] = zero

    @inline
    def restrict(group, solver, shared):
        v, coarse = solver.vectors, solver.coarse
        lane, base = place_of()
        first, last, running = solver.groups.starts[group], solver.groups.starts[group + next_one], zero
        for begin in range(first, last, team):
            a, b, c, d, e, f = zero, zero, zero, zero, zero, zero
            if begin + lane < last:
                k = solver.groups.members[begin + lane]
                r = load_quad(v.residual, k)
                a, b, c, d, e, f = moment(arm_of(k, group, v, coarse), r[0], r[1], r[2])
            at = np.int32(base + lane)
            shared[at], shared[at + team], shared[at + 2 * team] = a, b, c
            shared[at + 3 * team], shared[at + 4 * team], shared[at + 5 * team] = d, e, f
            running = add_team(shared, base, modes, lane, running)
        if lane < modes:
            coarse.solved[modes * group + lane] = running

    @inline
    def corrected(k, solver):
        group, coarse = solver.groups.group[k], solver.coarse
        y = load_six(coarse.solved, np.int32(modes * group), next_one)
        return motion(arm_of(k, group, solver.vectors, coarse), y)

    return SimpleNamespace(centre=centre, restrict=restrict, corrected=corrected)


@cache
def make_couple(real: Real, math: str) -> Callable:
    """Make couple(pair, solver, shared): for a block, the coupling of two groups by the matrix."""
    inline, columns = inlined(math), device_formulas(formulas_of, real, math).columns
    load_block, arm_of = make_block_access(math).load_block, make_arm(real, math)
    zero, next_one, none = real(0), np.int32(1), np.int32(0)
    modes, tile, entries = np.int32(MODES), np.int32(TILE), np.int32(ENTRIES)

    @inline
    def couple(pair, solver, shared):
        v, coarse = solver.vectors, solver.coarse
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        group, other, width = solver.pairs.first[pair], solver.pairs.second[pair], coarse.width
        first, last = solver.pairs.starts[pair], solver.pairs.starts[pair + next_one]
        for e in range(t, entries, threads):
            shared[tile * entries + e] = zero
        for begin in range(first, last, tile):
            many = np.int32(min(tile, np.int32(last - begin)))
            cuda.syncthreads()
            for n in range(t, many, threads):
                b = solver.pairs.blocks[begin + n]
                d, e = arm_of(solver.pairs.row[b], group, v, coarse), arm_of(solver.rows.columns[b], other, v, coarse)
                block = columns(d, e, load_block(solver.matrix.blocks, b))
                for j in range(MODES):
                    for i in range(MODES):
                        shared[(modes * i + j) * tile + n] = block[j][i]
            cuda.syncthreads()
            for e in range(t, entries, threads):
                running = shared[tile * entries + e]
                for n in range(many):
                    running = running + shared[e * tile + n]
                shared[tile * entries + e] = running
        for e in range(t, entries, threads):
            i, j = np.int32(e // modes), np.int32(e % modes)
            place = np.int32(modes * (other - group) + j - i)
            if place >= none:
                coarse.band[(modes * group + i) * width + place] = shared[tile * entries + e]
                if place == none:
                    coarse.entries[modes * group + i] = shared[tile * entries + e]
        cuda.syncthreads()

    return couple


@cache
def make_band(real: Real, math: str) -> SimpleNamespace:
    """Make `factor(body, solver)` and `solve(body, solver, shared)`.

    `factor`: for a block; 1 if the body's coarse matrix is not positive, else 0. `solve`: for a team; every entry is
    updated in the order of the CPU.
    """
    inline, pivot = inlined(math), device_formulas(formulas_of, real, math).pivot
    moved, times = device_formulas(newton, real, math).moved, device_formulas(solving, real, math).times
    synchronize_team, zero, one = make_sums(real, math).synchronize_team, real(0), real(1)
    team, modes, next_one, none, capacity = (
        np.int32(TEAM),
        np.int32(MODES),
        np.int32(1),
        np.int32(0),
        np.int32(MODES * MOST),
    )

    @inline
    def factor(body, solver):
        coarse = solver.coarse
        t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
        band, width, bad, last_inverse, last_many = coarse.band, coarse.width, zero, zero, none
        for k in range(modes * solver.pairs.bodies[body], modes * solver.pairs.bodies[body + next_one]):
            cuda.syncthreads()
            row, many = np.int32(k * width), np.int32(solver.groups.reach[k] - k)
            inverse, negative = pivot(band[row], coarse.entries[k])
            if negative:
                bad = one
            if t == none:
                coarse.pivots[k] = inverse
            for j in range(t + next_one, last_many + next_one, threads):  # of the row before, which all have read
                band[row - width + j] = times(last_inverse, band[row - width + j])
            for i in range(t // team + next_one, many + next_one, threads // team):
                factor, target = -times(inverse, band[row + i]), np.int32((k + i) * width)
                for j in range(t % team, many - i + next_one, team):
                    band[target + j] = moved(band[target + j], factor, times(inverse, band[row + i + j]))
            last_inverse, last_many = inverse, many
        cuda.syncthreads()
        return bad

    @inline
    def solve(body, solver, shared):
        coarse = solver.coarse
        t = np.int32(cuda.threadIdx.x)
        lane, base = np.int32(t % team), np.int32(t // team * capacity)
        band, width = coarse.band, coarse.width
        first, last = (
            np.int32(modes * solver.pairs.bodies[body]),
            np.int32(modes * solver.pairs.bodies[body + next_one]),
        )
        for k in range(first + lane, last, team):
            shared[base + k - first] = coarse.solved[k]
        synchronize_team()
        for k in range(first, last):
            at, row, many = np.int32(base + k - first), np.int32(k * width), np.int32(solver.groups.reach[k] - k)
            y = times(coarse.pivots[k], shared[at])
            for j in range(lane + next_one, many + next_one, team):
                shared[at + j] = moved(shared[at + j], -y, band[row + j])
            synchronize_team()
            if lane == none:
                shared[at] = y
        synchronize_team()
        for n in range(last - first):
            k = np.int32(last - next_one - n)
            at = np.int32(base + k - first)
            y = times(coarse.pivots[k], shared[at])
            i = np.int32(k - next_one - lane)
            while i >= first and solver.groups.reach[i] >= k:
                shared[base + i - first] = moved(shared[base + i - first], -y, band[i * width + k - i])
                i = np.int32(i - team)
            synchronize_team()
            if lane == none:
                coarse.solved[k] = y
        synchronize_team()

    return SimpleNamespace(factor=factor, solve=solve)
