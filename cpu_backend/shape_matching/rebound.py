"""Rigid bodies that rebound from colliders as a whole, on CPU threads: clusters sum up the impulses on their particles,
and particles move with the body's resulting motion (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import gather_motion
from softlab.cpu_backend.shape_matching.kernels import AXES, GATHERS, lane_sum
from softlab.cpu_backend.shape_matching.layout import LONE
from softlab.cpu_backend.shape_matching.motions import motion_of
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, routine, row_routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOTION
from softlab.model.formulas.shape_matching.rebound import asked, bound, enlarged, rebounded, scaled, weighed
from softlab.model.formulas.shape_matching.rebound import touched as touched_mass
from softlab.model.shape_matching.motions import velocity_at


@row_routine
def worth_rows(blocks, motion, slots, x, y, z, vx, vy, vz, wanted, mass, lanes):
    for n in range(4 * LANES):
        lanes[n] = 0.0
    for block in range(blocks):
        for lane in range(LANES):
            e = block * LANES + lane
            k, m = slots[e] if GATHERS else e, mass[e]
            u, v, w = velocity_at(motion, x[k], y[k], z[k])
            lanes[lane] = weighed(lanes[lane], m, vx[k], vy[k], vz[k])
            lanes[LANES + lane] = weighed(lanes[LANES + lane], m, u, v, w)
            if FEATURE.pairs:
                lanes[2 * LANES + lane] = touched_mass(lanes[2 * LANES + lane], m, vx[k], vy[k], vz[k])
                lanes[3 * LANES + lane] = asked(lanes[3 * LANES + lane], m, wanted[k], vx[k], vy[k], vz[k])


sum_worth = filled(worth_rows, {"GATHERS": False})
gather_worth = filled(worth_rows, {"GATHERS": True})


@row_routine
def any_row(blocks, x, y, z):
    any_impulse = np.int32(0)
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            any_impulse |= np.int32((x[k] != 0.0) | (y[k] != 0.0) | (z[k] != 0.0))
    return any_impulse != 0


@routine
def touched(c, count, arrays):
    """Return True if a particle of cluster c got an impulse; for a straight cluster also a particle behind it in
    its block."""
    impulses, starts, slots, first = (
        arrays.rebound.impulses, arrays.starts, arrays.slots, np.int64(arrays.firsts[c])
    )  # fmt: skip
    if arrays.straight[c]:
        return any_row(
            (starts[c + 1] - starts[c]) // LANES, row_at(impulses, first), row_at(impulses, count + first),
            row_at(impulses, 2 * count + first),
        )  # fmt: skip
    for e in range(starts[c], starts[c + 1]):
        k = slots[e]
        if impulses[k] != 0.0 or impulses[count + k] != 0.0 or impulses[2 * count + k] != 0.0:
            return True
    return False


@routine
def respond_as_one(c, position, count, arrays, scratch):
    """Write the rigid motion of cluster `c` that results from the impulses on its particles; none for a cluster that does not
    rebound as a whole.

    For `pairs` of bodies in contact the first three numbers are replaced by the components of a pair's factor
    (formulas/shape_matching/rebound.py, `shared`).
    """
    limit, motions = arrays.rebound.limits[c], arrays.rebound.motions
    if limit == 0.0:
        return
    impulses, scales, motion = arrays.rebound.impulses, arrays.rebound.scales, row_at(motions, np.int64(MOTION * c))
    if not touched(c, count, arrays):
        for n in range(MOTION):
            motion[n] = 0.0
        return
    gather_motion(c, position, impulses, count, arrays, motions, scratch)
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
    if FEATURE.pairs:
        total = lane_sum(scratch, 3)
        motion[0] = bound(lane_sum(scratch, 0), lane_sum(scratch, 2), total, arrays.centres[4 * c + 3])
        motion[1], motion[2] = total, lane_sum(scratch, 1)
        return
    scale = enlarged(lane_sum(scratch, 0), lane_sum(scratch, 1), limit)
    for n in range(AXES, MOTION):
        motion[n] = scaled(motion[n], scale)


@routine
def note_velocities(first, last, velocity, count, arrays):
    """Store the velocities of particles before colliders."""
    impulses = arrays.rebound.impulses
    for axis in range(AXES):
        for k in range(axis * count + first, axis * count + last):
            impulses[k] = velocity[k]


@routine
def store_changes(first, last, velocity, count, arrays):
    """Write the impulses of colliders on particles."""
    impulses = arrays.rebound.impulses
    for axis in range(AXES):
        for k in range(axis * count + first, axis * count + last):
            impulses[k] = velocity[k] - impulses[k]


@row_routine
def go_rows(blocks, motion, x, y, z, impulse_x, impulse_y, impulse_z, vx, vy, vz):
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            u, v, w = velocity_at(motion, x[k], y[k], z[k])
            vx[k], vy[k] = rebounded(vx[k], impulse_x[k], u), rebounded(vy[k], impulse_y[k], v)
            vz[k] = rebounded(vz[k], impulse_z[k], w)


@row_routine
def stay_rows(blocks, vx, vy, vz):
    """Apply the result of go_rows for no impulse: -0 becomes 0."""
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            vx[k], vy[k], vz[k] = vx[k] + 0.0, vy[k] + 0.0, vz[k] + 0.0


@routine
def respond(c, position, velocity, count, arrays, scratch):
    """Write the response of cluster `c`, and the velocities of its particles if it is LONE."""
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


@routine
def go(first, last, position, velocity, count, arrays):
    """Move the particles of clusters that are not LONE with the response."""
    whole, impulses = arrays.rebound, arrays.rebound.impulses
    for k in range(first, last):
        x, y, z = k, count + k, 2 * count + k
        for n in range(whole.starts[k], whole.starts[k + 1]):
            c = whole.clusters[n]
            if whole.factors[n] != 0.0 and whole.kinds[c] != LONE:
                u, v, w = velocity_at(motion_of(whole.motions, c), position[x], position[y], position[z])
                velocity[x] = rebounded(velocity[x], impulses[x], u)
                velocity[y] = rebounded(velocity[y], impulses[y], v)
                velocity[z] = rebounded(velocity[z], impulses[z], w)


@routine
def note(band, bands, velocity, count, arrays):
    """Store the velocities of all particles before colliders."""
    note_velocities(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)


@routine
def rebound(team, member, bands, position, velocity, count, arrays, scratch, pitch):
    """Apply the response of all clusters after colliders; `pitch`: numbers in a band's scratch."""
    clusters = arrays.centres.size // 4
    for band in assigned(team, member, bands):
        store_changes(count * band // bands, count * (band + 1) // bands, velocity, count, arrays)
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        for c in range(clusters * band // bands, clusters * (band + 1) // bands):
            respond(c, position, velocity, count, arrays, band_scratch)
    for band in assigned(team, member, bands):
        go(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)


@cache
def make_rebound_stages(real: Real, math: str) -> SimpleNamespace:
    """Compile `note(bands, velocity, count, arrays)` and, after colliders, `rebound(bands, position, velocity, count,
    arrays, scratch, pitch)`."""
    compiler = Compiler(f"bodies_rebound_{np.dtype(real).name}_{math}", math)
    copied = compiler.variant_of(real, {"pairs": False}).copied
    return SimpleNamespace(note=compiler.banded(copied(note)), rebound=compiler.team(copied(rebound)))
