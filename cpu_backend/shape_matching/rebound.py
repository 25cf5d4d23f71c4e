"""Rigid bodies that rebound from colliders as a whole, on CPU threads: clusters sum up the impulses on their particles,
and particles move with the body's resulting motion (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import shares
from softlab.cpu_backend.shape_matching.damping import make_damping, make_lane_sum
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.cpu_backend.shape_matching.layout import LONE
from softlab.cpu_backend.shape_matching.motions import make_motions
from softlab.model.formulas.shape_matching import rebound
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOTION


def make_answer(compiler: Compiler, real: Any, meets: bool = False) -> Any:
    """Make answer(c, position, count, arrays, scratch): the rigid motion of cluster c that results from the impulses on
    its particles; none for a cluster that does not rebound as a whole.

    `meets`: for bodies in contact the first three numbers are replaced by the components of a pair's factor
    (rebound.py, `shared`).
    """
    formulas, sum_of = rebound.make(real, compiler.compiled), make_lane_sum(compiler, real)
    weighed, enlarged, scaled = formulas.weighed, formulas.enlarged, formulas.scaled
    of_motions = make_motions(compiler, real)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at
    gather = make_damping(compiler, real, True).gather
    touched_mass, asked, bound = formulas.touched, formulas.asked, formulas.bound
    zero = real(0)

    def make_rows(gathers: bool) -> Any:
        def worth_rows(blocks, motion, slots, x, y, z, vx, vy, vz, wanted, mass, lanes):
            for n in range(4 * LANES):
                lanes[n] = zero
            for block in range(blocks):
                for lane in range(LANES):
                    e = block * LANES + lane
                    k, m = slots[e] if gathers else e, mass[e]
                    u, v, w = velocity_at(motion, x[k], y[k], z[k])
                    lanes[lane] = weighed(lanes[lane], m, vx[k], vy[k], vz[k])
                    lanes[LANES + lane] = weighed(lanes[LANES + lane], m, u, v, w)
                    if meets:
                        lanes[2 * LANES + lane] = touched_mass(lanes[2 * LANES + lane], m, vx[k], vy[k], vz[k])
                        lanes[3 * LANES + lane] = asked(lanes[3 * LANES + lane], m, wanted[k], vx[k], vy[k], vz[k])

        worth_rows.__name__ = "gather_worth" if gathers else "sum_worth"
        return compiler.row(worth_rows)

    sum_worth, gather_worth = make_rows(False), make_rows(True)

    @compiler.row
    def any_row(blocks, x, y, z):
        found = np.int32(0)
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                found |= np.int32((x[k] != zero) | (y[k] != zero) | (z[k] != zero))
        return found != 0

    @compiler.compiled
    def touched(c, count, arrays):
        """Return True if a particle of cluster c got an impulse; for a straight cluster also a particle behind it in
        its block."""
        struck, starts, slots, first = arrays.rebound.impulses, arrays.starts, arrays.slots, np.int64(arrays.firsts[c])
        if arrays.straight[c]:
            return any_row(
                (starts[c + 1] - starts[c]) // LANES, row_at(struck, first), row_at(struck, count + first),
                row_at(struck, 2 * count + first),
            )  # fmt: skip
        for e in range(starts[c], starts[c + 1]):
            k = slots[e]
            if struck[k] != zero or struck[count + k] != zero or struck[2 * count + k] != zero:
                return True
        return False

    @compiler.compiled
    def answer(c, position, count, arrays, scratch):
        limit, motions = arrays.rebound.limits[c], arrays.rebound.motions
        if limit == zero:
            return
        struck, scales, motion = arrays.rebound.impulses, arrays.rebound.scales, row_at(motions, np.int64(MOTION * c))
        if not touched(c, count, arrays):
            for n in range(MOTION):
                motion[n] = zero
            return
        gather(c, position, struck, count, arrays, motions, scratch)
        starts, slots, members, first = arrays.starts, arrays.slots, arrays.members, np.int64(arrays.firsts[c])
        start, blocks, mass = starts[c], (starts[c + 1] - starts[c]) // LANES, 3 * (members.size // 4)
        if arrays.straight[c]:
            sum_worth(
                blocks, motion_of(motions, c), row_at(slots, start), row_at(position, first), row_at(position, count + first),
                row_at(position, 2 * count + first), row_at(struck, first), row_at(struck, count + first),
                row_at(struck, 2 * count + first), row_at(scales, first), row_at(members, mass + start), scratch,
            )  # fmt: skip
        else:
            gather_worth(
                blocks, motion_of(motions, c), row_at(slots, start), position, row_at(position, count),
                row_at(position, 2 * count), struck, row_at(struck, count), row_at(struck, 2 * count), scales,
                row_at(members, mass + start), scratch,
            )  # fmt: skip
        if meets:
            total = sum_of(scratch, 3)
            motion[0] = bound(sum_of(scratch, 0), sum_of(scratch, 2), total, arrays.centres[4 * c + 3])
            motion[1], motion[2] = total, sum_of(scratch, 1)
            return
        scale = enlarged(sum_of(scratch, 0), sum_of(scratch, 1), limit)
        for n in range(AXES, MOTION):
            motion[n] = scaled(motion[n], scale)

    return SimpleNamespace(answer=answer, touched=touched)


def make_rebound(compiler: Compiler, real: Any, rebounds: bool) -> SimpleNamespace:
    """Make the functions of rebounds; they do nothing unless a body `rebounds`.

    `note(first, last, velocity, count, arrays)`: before colliders; `strike(first, last, velocity, count, arrays)`:
    after them, the impulses on particles; `answer(c, position, velocity, count, arrays, scratch)`: the response of
    cluster c, also of its particles if it is LONE; `go(first, last, position, velocity, count, arrays)`: particles of
    others.
    """
    if not rebounds:
        return _without(compiler)
    formulas, made = rebound.make(real, compiler.compiled), make_answer(compiler, real)
    rebounded, touched, answer_whole = formulas.rebounded, made.touched, made.answer
    of_motions, zero = make_motions(compiler, real), real(0)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at

    @compiler.compiled
    def note(first, last, velocity, count, arrays):
        struck = arrays.rebound.impulses
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                struck[k] = velocity[k]

    @compiler.compiled
    def strike(first, last, velocity, count, arrays):
        struck = arrays.rebound.impulses
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                struck[k] = velocity[k] - struck[k]

    @compiler.row
    def go_rows(blocks, motion, x, y, z, struck_x, struck_y, struck_z, vx, vy, vz):
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                u, v, w = velocity_at(motion, x[k], y[k], z[k])
                vx[k], vy[k] = rebounded(vx[k], struck_x[k], u), rebounded(vy[k], struck_y[k], v)
                vz[k] = rebounded(vz[k], struck_z[k], w)

    @compiler.row
    def stay_rows(blocks, vx, vy, vz):
        """Apply the result of go_rows for no impulse: -0 becomes 0."""
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                vx[k], vy[k], vz[k] = vx[k] + zero, vy[k] + zero, vz[k] + zero

    @compiler.compiled
    def answer(c, position, velocity, count, arrays, scratch):
        first, blocks = np.int64(arrays.firsts[c]), (arrays.starts[c + 1] - arrays.starts[c]) // LANES
        x, y, z = first, count + first, 2 * count + first
        if arrays.rebound.kinds[c] == LONE and not touched(c, count, arrays):
            stay_rows(blocks, row_at(velocity, x), row_at(velocity, y), row_at(velocity, z))
            return
        answer_whole(c, position, count, arrays, scratch)
        if arrays.rebound.kinds[c] == LONE:
            struck = arrays.rebound.impulses
            go_rows(
                blocks, motion_of(arrays.rebound.motions, c), row_at(position, x), row_at(position, y), row_at(position, z),
                row_at(struck, x), row_at(struck, y), row_at(struck, z), row_at(velocity, x),
                row_at(velocity, y), row_at(velocity, z),
            )  # fmt: skip

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        whole, struck = arrays.rebound, arrays.rebound.impulses
        for k in range(first, last):
            x, y, z = k, count + k, 2 * count + k
            for n in range(whole.starts[k], whole.starts[k + 1]):
                c = whole.clusters[n]
                if whole.factors[n] != zero and whole.kinds[c] != LONE:
                    u, v, w = velocity_at(motion_of(whole.motions, c), position[x], position[y], position[z])
                    velocity[x], velocity[y] = (
                        rebounded(velocity[x], struck[x], u),
                        rebounded(velocity[y], struck[y], v),
                    )
                    velocity[z] = rebounded(velocity[z], struck[z], w)

    return SimpleNamespace(note=note, strike=strike, answer=answer, go=go)


def _without(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def answer(c, position, velocity, count, arrays, scratch):
        pass

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        pass

    return SimpleNamespace(answer=answer, go=go)


@cache
def make_rebound_stages(real: Any, math: str) -> SimpleNamespace:
    """Compile `note(bands, velocity, count, arrays)` and, after colliders, `rebound(bands, position, velocity, count,
    arrays, scratch, pitch)`: all particles, then all clusters, then all particles; `pitch`: numbers in a band's
    scratch."""
    compiler = Compiler(f"bodies_rebound_{np.dtype(real).name}_{math}", math)
    made = make_rebound(compiler, real, True)
    note_some, strike, answer, go = made.note, made.strike, made.answer, made.go

    def note(band, bands, velocity, count, arrays):
        note_some(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)

    def rebound(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        clusters = arrays.centres.size // 4
        for band in shares(team, member, bands):
            strike(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)
        for band in shares(team, member, bands):
            room = row_at(scratch, np.int64(pitch * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                answer(c, position, velocity, count, arrays, room)
        for band in shares(team, member, bands):
            go(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)

    return SimpleNamespace(note=compiler.banded(note), rebound=compiler.team(rebound))
