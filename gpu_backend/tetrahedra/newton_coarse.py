"""The coarse level of Newton's method on tetrahedra, on CUDA: the sums of cpu_backend/tetrahedra/newton_coarse.py.

A team processes a group of particles, or solves for a body; a block processes a pair of groups that the matrix couples,
or factors a body's matrix column by column. `shared` is a block's memory (newton_sums.py).
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.tetrahedra.newton_elements import load_block, load_six
from softlab.gpu_backend.tetrahedra.newton_sums import CAPACITY, TEAM, TEAMS, add_team, synchronize_team
from softlab.model.base.variant import inlined_routine, real, unrolled
from softlab.model.formulas.elastic.coarse import arm, columns, moment, motion, pivot, scale_of
from softlab.model.formulas.elastic.newton import moved
from softlab.model.formulas.elastic.solving import dot, times
from softlab.model.tetrahedra.aggregates import MODES, MOST

TILE = 64  # blocks of a pair of groups that are projected onto rigid motions at once
ENTRIES = MODES * MODES
NO_MOMENTS = (0.0,) * MODES
assert max((TILE + 1) * ENTRIES, TEAMS * MODES * MOST, TEAMS * MODES * TEAM) <= CAPACITY


@inlined_routine
def arm_of(k, group, v, coarse):
    """Return the vector to particle k from the group's centre, scaled."""
    p, c = load_quad(v.position, k), load_quad(coarse.centres, group)
    return arm(p[0], p[1], p[2], c[0], c[1], c[2], c[3])


@inlined_routine
def place_of():
    """Return (lane, start of the team's part of the block's memory)."""
    t = np.int32(cuda.threadIdx.x)
    return np.int32(t % TEAM), np.int32(t // TEAM * (MODES * TEAM))


@inlined_routine
def centre(group, solver, shared):
    """Write a group's centre and scale, for a team, and set its rows of the matrix to 0."""
    v, coarse = solver.vectors, solver.coarse
    lane, base = place_of()
    first, last = solver.groups.starts[group], solver.groups.starts[group + 1]
    count, running = real(last - first), 0.0
    for begin in range(first, last, np.int32(TEAM)):
        x, y, z = 0.0, 0.0, 0.0
        if begin + lane < last:
            p = load_quad(v.position, solver.groups.members[begin + lane])
            x, y, z = p[0], p[1], p[2]
        shared[base + lane], shared[base + TEAM + lane], shared[base + 2 * TEAM + lane] = x, y, z
        running = add_team(shared, base, np.int32(3), lane, running)
    if lane < 3:
        shared[base + lane] = running / count
    synchronize_team()
    cx, cy, cz = shared[base], shared[base + 1], shared[base + 2]
    synchronize_team()
    running = 0.0
    for begin in range(first, last, np.int32(TEAM)):
        squared = 0.0
        if begin + lane < last:
            p = load_quad(v.position, solver.groups.members[begin + lane])
            p, q, r = arm(p[0], p[1], p[2], cx, cy, cz, 1.0)
            squared = dot(p, q, r, p, q, r)
        shared[base + lane] = squared
        running = add_team(shared, base, np.int32(1), lane, running)
    if lane == np.int32(0):
        store_quad(coarse.centres, group, cx, cy, cz, scale_of(running, count))
    width = coarse.width
    for n in range(lane, MODES * width, TEAM):
        coarse.band[MODES * group * width + n] = 0.0


@inlined_routine
def restrict(group, solver, shared):
    """Write a group's residual, seen by rigid motions, for a team."""
    v, coarse = solver.vectors, solver.coarse
    lane, base = place_of()
    first, last, running = solver.groups.starts[group], solver.groups.starts[group + 1], 0.0
    for begin in range(first, last, np.int32(TEAM)):
        moments = NO_MOMENTS
        if begin + lane < last:
            k = solver.groups.members[begin + lane]
            r = load_quad(v.residual, k)
            moments = moment(arm_of(k, group, v, coarse), r[0], r[1], r[2])
        for mode in unrolled(MODES):
            shared[base + lane + mode * TEAM] = moments[mode]
        running = add_team(shared, base, np.int32(MODES), lane, running)
    if lane < MODES:
        coarse.solved[MODES * group + lane] = running


@inlined_routine
def corrected(k, solver):
    """Return three numbers to add at particle k."""
    group, coarse = solver.groups.group[k], solver.coarse
    y = load_six(coarse.solved, np.int32(MODES * group), np.int32(1))
    return motion(arm_of(k, group, solver.vectors, coarse), y)


@inlined_routine
def couple(pair, solver, shared):
    """Write the coupling of two groups by the matrix, for a block."""
    v, coarse = solver.vectors, solver.coarse
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    group, other, width = solver.pairs.first[pair], solver.pairs.second[pair], coarse.width
    first, last = solver.pairs.starts[pair], solver.pairs.starts[pair + 1]
    for e in range(t, np.int32(ENTRIES), threads):
        shared[TILE * ENTRIES + e] = 0.0
    for begin in range(first, last, np.int32(TILE)):
        many = np.int32(min(np.int32(TILE), np.int32(last - begin)))
        cuda.syncthreads()
        for n in range(t, many, threads):
            b = solver.pairs.blocks[begin + n]
            d, e = arm_of(solver.pairs.row[b], group, v, coarse), arm_of(solver.rows.columns[b], other, v, coarse)
            block = columns(d, e, load_block(solver.matrix.blocks, b))
            for j in range(MODES):
                for i in range(MODES):
                    shared[(MODES * i + j) * TILE + n] = block[j][i]
        cuda.syncthreads()
        for e in range(t, np.int32(ENTRIES), threads):
            running = shared[TILE * ENTRIES + e]
            for n in range(many):
                running = running + shared[e * TILE + n]
            shared[TILE * ENTRIES + e] = running
    for e in range(t, np.int32(ENTRIES), threads):
        i, j = np.int32(e // MODES), np.int32(e % MODES)
        place = np.int32(MODES * (other - group) + j - i)
        if place >= np.int32(0):
            coarse.band[(MODES * group + i) * width + place] = shared[TILE * ENTRIES + e]
            if place == np.int32(0):
                coarse.entries[MODES * group + i] = shared[TILE * ENTRIES + e]
    cuda.syncthreads()


@inlined_routine
def factor(body, solver):
    """Factor a body's coarse matrix, for a block. Returns 1 if it is not positive, else 0."""
    coarse = solver.coarse
    t, threads = np.int32(cuda.threadIdx.x), np.int32(cuda.blockDim.x)
    band, width, bad, last_inverse, last_many = coarse.band, coarse.width, 0.0, 0.0, np.int32(0)
    for k in range(MODES * solver.pairs.bodies[body], MODES * solver.pairs.bodies[body + 1]):
        cuda.syncthreads()
        row, many = np.int32(k * width), np.int32(solver.groups.last_column[k] - k)
        inverse, negative = pivot(band[row], coarse.entries[k])
        if negative:
            bad = 1.0
        if t == np.int32(0):
            coarse.pivots[k] = inverse
        for j in range(t + 1, last_many + 1, threads):  # of the row before, which all have read
            band[row - width + j] = times(last_inverse, band[row - width + j])
        for i in range(t // TEAM + 1, many + 1, threads // TEAM):
            factor, target = -times(inverse, band[row + i]), np.int32((k + i) * width)
            for j in range(t % TEAM, many - i + 1, TEAM):
                band[target + j] = moved(band[target + j], factor, times(inverse, band[row + i + j]))
        last_inverse, last_many = inverse, many
    cuda.syncthreads()
    return bad


@inlined_routine
def solve(body, solver, shared):
    """Solve a body's coarse system, for a team; every entry is updated in the order of the CPU."""
    coarse = solver.coarse
    t = np.int32(cuda.threadIdx.x)
    lane, base = np.int32(t % TEAM), np.int32(t // TEAM * (MODES * MOST))
    band, width = coarse.band, coarse.width
    first, last = np.int32(MODES * solver.pairs.bodies[body]), np.int32(MODES * solver.pairs.bodies[body + 1])
    for k in range(first + lane, last, TEAM):
        shared[base + k - first] = coarse.solved[k]
    synchronize_team()
    for k in range(first, last):
        at, row, many = np.int32(base + k - first), np.int32(k * width), np.int32(solver.groups.last_column[k] - k)
        y = times(coarse.pivots[k], shared[at])
        for j in range(lane + 1, many + 1, TEAM):
            shared[at + j] = moved(shared[at + j], -y, band[row + j])
        synchronize_team()
        if lane == np.int32(0):
            shared[at] = y
    synchronize_team()
    for n in range(last - first):
        k = np.int32(last - 1 - n)
        at = np.int32(base + k - first)
        y = times(coarse.pivots[k], shared[at])
        i = np.int32(k - 1 - lane)
        while i >= first and solver.groups.last_column[i] >= k:
            shared[base + i - first] = moved(shared[base + i - first], -y, band[i * width + k - i])
            i = np.int32(i - TEAM)
        synchronize_team()
        if lane == np.int32(0):
            coarse.solved[k] = y
    synchronize_team()
