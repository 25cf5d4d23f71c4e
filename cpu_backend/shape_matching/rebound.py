"""Rigid bodies that come off colliders as a whole, on CPU threads: clusters gather what colliders gave to their particles,
particles go with the motion that the body makes of it. See model/shape_matching/rigid_rebound.py."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from cpu_backend.core.compile import Compiler
from cpu_backend.core.layout import row_at
from cpu_backend.core.progress import shares
from cpu_backend.shape_matching.damping import at_damping, make_damping, make_lane_sum
from cpu_backend.shape_matching.kernels import AXES
from model.formulas.shape_matching import rebound
from model.formulas.shape_matching.cluster import LANES
from model.formulas.shape_matching.pace import MOTION

DAMPING = 4  # arrays of clusters that damping takes, after whose come those of here


def at_rebound(parts: frozenset[str]) -> int:
    """Where in the clusters' arrays those of rebounds lie."""
    return at_damping(parts) + DAMPING * ("cluster_damping" in parts)


def make_rebound(compiler: Compiler, real: Any, rebounds: bool, place: int) -> SimpleNamespace:
    """`note(first, last, velocity, count, arrays)`: before colliders; `strike(first, last, velocity, count, arrays)`: after
    them, what particles got; `answer(c, position, count, arrays, scratch)`: what cluster c makes of it; `go(first, last,
    position, velocity, count, arrays)`: particles. Arrays from `place` on: as of damping, factors 1 of clusters that come off
    as a whole; limits (clusters,), 0 of the others; what particles got, three planes. Not done unless a body `rebounds`."""
    if not rebounds:
        return _without(compiler)
    formulas, sum_of = rebound.make(real, compiler.compiled), make_lane_sum(compiler, real)
    weighed, rigid, enlarged = formulas.weighed, formulas.rigid, formulas.enlarged
    scaled, rebounded = formulas.scaled, formulas.rebounded
    gather = make_damping(compiler, real, True, place).gather
    at_factors, at_motions, at_limits, at_struck = place + 2, place + 3, place + 4, place + 5
    at_clusters, zero = place + 1, real(0)

    @compiler.compiled
    def note(first, last, velocity, count, arrays):
        struck = arrays[at_struck]
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                struck[k] = velocity[k]

    @compiler.compiled
    def strike(first, last, velocity, count, arrays):
        struck = arrays[at_struck]
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                struck[k] = velocity[k] - struck[k]

    @compiler.row
    def worth_rows(blocks, motion, slots, x, y, z, vx, vy, vz, mass, lanes):
        for n in range(2 * LANES):
            lanes[n] = zero
        for block in range(blocks):
            for lane in range(LANES):
                e = block * LANES + lane
                k, m = slots[e], mass[e]
                dx, dy, dz = x[k] - motion[0], y[k] - motion[1], z[k] - motion[2]
                u = rigid(motion[3], motion[7], dz, motion[8], dy)
                v = rigid(motion[4], motion[8], dx, motion[6], dz)
                w = rigid(motion[5], motion[6], dy, motion[7], dx)
                lanes[lane] = weighed(lanes[lane], m, vx[k], vy[k], vz[k])
                lanes[LANES + lane] = weighed(lanes[LANES + lane], m, u, v, w)

    @compiler.compiled
    def answer(c, position, count, arrays, scratch):
        """Returned: what the motion was multiplied by; 0 of a cluster that does not come off as a whole."""
        limit = arrays[at_limits][c]
        if limit == zero:
            return zero
        struck, motion = arrays[at_struck], row_at(arrays[at_motions], np.int64(MOTION * c))
        starts, slots, members = arrays[0], arrays[3], arrays[4]
        start, entries = starts[c], members.size // 4
        touched = False
        for e in range(start, starts[c + 1]):
            k = slots[e]
            if struck[k] != zero or struck[count + k] != zero or struck[2 * count + k] != zero:
                touched = True
                break
        if not touched:
            for n in range(MOTION):
                motion[n] = zero
            return zero
        gather(c, position, struck, count, arrays, scratch)
        worth_rows(
            (starts[c + 1] - start) // LANES, motion, row_at(slots, start), position, row_at(position, count),
            row_at(position, 2 * count), struck, row_at(struck, count), row_at(struck, 2 * count),
            row_at(members, 3 * entries + start), scratch,
        )  # fmt: skip
        scale = enlarged(sum_of(scratch, 0), sum_of(scratch, 1), limit)
        for n in range(AXES, MOTION):
            motion[n] = scaled(motion[n], scale)
        return scale

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        starts, clusters, factors, motions = arrays[place], arrays[at_clusters], arrays[at_factors], arrays[at_motions]
        struck = arrays[at_struck]
        for k in range(first, last):
            for n in range(starts[k], starts[k + 1]):
                if factors[n] != zero:
                    g = row_at(motions, np.int64(MOTION) * clusters[n])
                    dx, dy, dz = position[k] - g[0], position[count + k] - g[1], position[2 * count + k] - g[2]
                    x, y, z = k, count + k, 2 * count + k
                    velocity[x] = rebounded(velocity[x], struck[x], rigid(g[3], g[7], dz, g[8], dy))
                    velocity[y] = rebounded(velocity[y], struck[y], rigid(g[4], g[8], dx, g[6], dz))
                    velocity[z] = rebounded(velocity[z], struck[z], rigid(g[5], g[6], dy, g[7], dx))

    return SimpleNamespace(note=note, strike=strike, answer=answer, go=go)


def _without(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def note(first, last, velocity, count, arrays):
        pass

    @compiler.compiled
    def strike(first, last, velocity, count, arrays):
        pass

    @compiler.compiled
    def answer(c, position, count, arrays, scratch):
        pass

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        pass

    return SimpleNamespace(note=note, strike=strike, answer=answer, go=go)


@cache
def make_rebound_stages(real: Any, math: str, place: int) -> SimpleNamespace:
    """`note(bands, velocity, count, arrays)`; after colliders `rebound(bands, position, velocity, count, arrays, scratch,
    pitch)`: all particles, then all clusters, then all particles; `pitch`: numbers of a band's scratch."""
    compiler = Compiler(f"bodies_rebound_{np.dtype(real).name}_{math}_{place}", math)
    made = make_rebound(compiler, real, True, place)
    note_some, strike, answer, go = made.note, made.strike, made.answer, made.go

    def note(band, bands, velocity, count, arrays):
        note_some(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)

    def rebound(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        clusters = arrays[5].size // 4
        for band in shares(team, member, bands):
            strike(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)
        for band in shares(team, member, bands):
            room = row_at(scratch, np.int64(pitch * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                answer(c, position, count, arrays, room)
        for band in shares(team, member, bands):
            go(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)

    return SimpleNamespace(note=compiler.banded(note), rebound=compiler.team(rebound))
