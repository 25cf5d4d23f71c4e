"""Rigid bodies that rebound from colliders as a whole, on CPU threads: clusters sum up the impulses on their particles,
and particles move with the body's resulting motion (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import make_damping, make_lane_sum
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.cpu_backend.shape_matching.layout import LONE
from softlab.cpu_backend.shape_matching.motions import make_motions
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import rebound
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOTION


def make_response(compiler: Compiler, real: Real, has_contacts: bool = False) -> SimpleNamespace:
    """Make respond(c, position, count, arrays, scratch): the rigid motion of cluster c that results from the impulses on
    its particles; none for a cluster that does not rebound as a whole.

    `has_contacts`: for bodies in contact the first three numbers are replaced by the components of a pair's factor
    (rebound.py, `shared`).
    """
    formulas, sum_of = compiler.formulas(rebound, real), make_lane_sum(compiler, real)
    weighed, enlarged, scaled = formulas.weighed, formulas.enlarged, formulas.scaled
    of_motions = make_motions(compiler, real)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at
    gather = make_damping(compiler, real, True).gather
    touched_mass, asked, bound = formulas.touched, formulas.asked, formulas.bound
    zero = real(0)

    def make_rows(gathers: bool) -> Callable:
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
                    if has_contacts:
                        lanes[2 * LANES + lane] = touched_mass(lanes[2 * LANES + lane], m, vx[k], vy[k], vz[k])
                        lanes[3 * LANES + lane] = asked(lanes[3 * LANES + lane], m, wanted[k], vx[k], vy[k], vz[k])

        worth_rows.__name__ = "gather_worth" if gathers else "sum_worth"
        return compiler.row(worth_rows)

    sum_worth, gather_worth = make_rows(False), make_rows(True)

    @compiler.row
    def any_row(blocks, x, y, z):
        any_impulse = np.int32(0)
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                any_impulse |= np.int32((x[k] != zero) | (y[k] != zero) | (z[k] != zero))
        return any_impulse != 0

    @compiler.compiled
    def touched(c, count, arrays):
        """Return True if a particle of cluster c got an impulse; for a straight cluster also a particle behind it in
        its block."""
        impulses, starts, slots, first = (
            arrays.rebound.impulses,
            arrays.starts,
            arrays.slots,
            np.int64(arrays.firsts[c]),
        )
        if arrays.straight[c]:
            return any_row(
                (starts[c + 1] - starts[c]) // LANES, row_at(impulses, first), row_at(impulses, count + first),
                row_at(impulses, 2 * count + first),
            )  # fmt: skip
        for e in range(starts[c], starts[c + 1]):
            k = slots[e]
            if impulses[k] != zero or impulses[count + k] != zero or impulses[2 * count + k] != zero:
                return True
        return False

    @compiler.compiled
    def respond(c, position, count, arrays, scratch):
        limit, motions = arrays.rebound.limits[c], arrays.rebound.motions
        if limit == zero:
            return
        impulses, scales, motion = arrays.rebound.impulses, arrays.rebound.scales, row_at(motions, np.int64(MOTION * c))
        if not touched(c, count, arrays):
            for n in range(MOTION):
                motion[n] = zero
            return
        gather(c, position, impulses, count, arrays, motions, scratch)
        starts, slots, members, first = arrays.starts, arrays.slots, arrays.members, np.int64(arrays.firsts[c])
        start, blocks, mass = starts[c], (starts[c + 1] - starts[c]) // LANES, 3 * (members.size // 4)
        if arrays.straight[c]:
            sum_worth(
                blocks, motion_of(motions, c), row_at(slots, start), row_at(position, first), row_at(position, count + first),
                row_at(position, 2 * count + first), row_at(impulses, first), row_at(impulses, count + first),
                row_at(impulses, 2 * count + first), row_at(scales, first), row_at(members, mass + start), scratch,
            )  # fmt: skip
        else:
            gather_worth(
                blocks, motion_of(motions, c), row_at(slots, start), position, row_at(position, count),
                row_at(position, 2 * count), impulses, row_at(impulses, count), row_at(impulses, 2 * count), scales,
                row_at(members, mass + start), scratch,
            )  # fmt: skip
        if has_contacts:
            total = sum_of(scratch, 3)
            motion[0] = bound(sum_of(scratch, 0), sum_of(scratch, 2), total, arrays.centres[4 * c + 3])
            motion[1], motion[2] = total, sum_of(scratch, 1)
            return
        scale = enlarged(sum_of(scratch, 0), sum_of(scratch, 1), limit)
        for n in range(AXES, MOTION):
            motion[n] = scaled(motion[n], scale)

    return SimpleNamespace(response=respond, touched=touched)


def make_rebound(compiler: Compiler, real: Real, rebounds: bool) -> SimpleNamespace:
    """Make the functions of rebounds; they do nothing unless a body `rebounds`.

    `note(first, last, velocity, count, arrays)`: before colliders; `store_impulses(first, last, velocity, count, arrays)`:
    after them, the impulses on particles; `respond(c, position, velocity, count, arrays, scratch)`: the response of
    cluster c, also of its particles if it is LONE; `go(first, last, position, velocity, count, arrays)`: particles of
    others.
    """
    if not rebounds:
        return _without(compiler)
    formulas, functions = compiler.formulas(rebound, real), make_response(compiler, real)
    rebounded, touched, respond_as_one = formulas.rebounded, functions.touched, functions.response
    of_motions, zero = make_motions(compiler, real), real(0)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at

    @compiler.compiled
    def note(first, last, velocity, count, arrays):
        impulses = arrays.rebound.impulses
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                impulses[k] = velocity[k]

    @compiler.compiled
    def store_impulses(first, last, velocity, count, arrays):
        impulses = arrays.rebound.impulses
        for axis in range(AXES):
            for k in range(axis * count + first, axis * count + last):
                impulses[k] = velocity[k] - impulses[k]

    @compiler.row
    def go_rows(blocks, motion, x, y, z, impulse_x, impulse_y, impulse_z, vx, vy, vz):
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                u, v, w = velocity_at(motion, x[k], y[k], z[k])
                vx[k], vy[k] = rebounded(vx[k], impulse_x[k], u), rebounded(vy[k], impulse_y[k], v)
                vz[k] = rebounded(vz[k], impulse_z[k], w)

    @compiler.row
    def stay_rows(blocks, vx, vy, vz):
        """Apply the result of go_rows for no impulse: -0 becomes 0."""
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                vx[k], vy[k], vz[k] = vx[k] + zero, vy[k] + zero, vz[k] + zero

    @compiler.compiled
    def respond(c, position, velocity, count, arrays, scratch):
        first, blocks = np.int64(arrays.firsts[c]), (arrays.starts[c + 1] - arrays.starts[c]) // LANES
        x, y, z = first, count + first, 2 * count + first
        if arrays.rebound.kinds[c] == LONE and not touched(c, count, arrays):
            stay_rows(blocks, row_at(velocity, x), row_at(velocity, y), row_at(velocity, z))
            return
        respond_as_one(c, position, count, arrays, scratch)
        if arrays.rebound.kinds[c] == LONE:
            impulses = arrays.rebound.impulses
            go_rows(
                blocks, motion_of(arrays.rebound.motions, c), row_at(position, x), row_at(position, y), row_at(position, z),
                row_at(impulses, x), row_at(impulses, y), row_at(impulses, z), row_at(velocity, x),
                row_at(velocity, y), row_at(velocity, z),
            )  # fmt: skip

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        whole, impulses = arrays.rebound, arrays.rebound.impulses
        for k in range(first, last):
            x, y, z = k, count + k, 2 * count + k
            for n in range(whole.starts[k], whole.starts[k + 1]):
                c = whole.clusters[n]
                if whole.factors[n] != zero and whole.kinds[c] != LONE:
                    u, v, w = velocity_at(motion_of(whole.motions, c), position[x], position[y], position[z])
                    velocity[x], velocity[y] = (
                        rebounded(velocity[x], impulses[x], u),
                        rebounded(velocity[y], impulses[y], v),
                    )
                    velocity[z] = rebounded(velocity[z], impulses[z], w)

    return SimpleNamespace(note=note, store_impulses=store_impulses, response=respond, go=go)


def _without(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def respond(c, position, velocity, count, arrays, scratch):
        pass

    @compiler.compiled
    def go(first, last, position, velocity, count, arrays):
        pass

    return SimpleNamespace(response=respond, go=go)


@cache
def make_rebound_stages(real: Real, math: str) -> SimpleNamespace:
    """Compile `note(bands, velocity, count, arrays)` and, after colliders, `rebound(bands, position, velocity, count,
    arrays, scratch, pitch)`: all particles, then all clusters, then all particles; `pitch`: numbers in a band's
    scratch."""
    compiler = Compiler(f"bodies_rebound_{np.dtype(real).name}_{math}", math)
    functions = make_rebound(compiler, real, True)
    note_some, store_impulses, respond, go = functions.note, functions.store_impulses, functions.response, functions.go

    def note(band, bands, velocity, count, arrays):
        note_some(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)

    def rebound(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        clusters = arrays.centres.size // 4
        for band in assigned(team, member, bands):
            store_impulses(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(pitch * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                respond(c, position, velocity, count, arrays, band_scratch)
        for band in assigned(team, member, bands):
            go(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)

    return SimpleNamespace(note=compiler.banded(note), rebound=compiler.team(rebound))
