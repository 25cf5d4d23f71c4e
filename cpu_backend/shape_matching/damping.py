"""Damping of the motion within clusters on CPU threads: clusters sum up momenta, particles approach the clusters' rigid
motions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.kernels import GATHERS, lane_sum
from softlab.cpu_backend.shape_matching.motions import slowed_velocity
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, routine, row_routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOMENTA, MOTION, added, cross_added, motion, weighted


@row_routine
def momenta_rows(blocks, x0, y0, z0, u0, v0, w0, slots, x, y, z, vx, vy, vz, mass, lanes):
    for n in range(MOMENTA * LANES):
        lanes[n] = 0.0
    for block in range(blocks):
        for lane in range(LANES):
            e = block * LANES + lane
            k, m = slots[e] if GATHERS else e, mass[e]
            dx, dy, dz = x[k] - x0, y[k] - y0, z[k] - z0
            wx, wy, wz = weighted(m, x[k], x0), weighted(m, y[k], y0), weighted(m, z[k], z0)
            ux, uy, uz = weighted(m, vx[k], u0), weighted(m, vy[k], v0), weighted(m, vz[k], w0)
            lanes[lane] = lanes[lane] + wx
            lanes[LANES + lane] = lanes[LANES + lane] + wy
            lanes[2 * LANES + lane] = lanes[2 * LANES + lane] + wz
            lanes[3 * LANES + lane] = lanes[3 * LANES + lane] + ux
            lanes[4 * LANES + lane] = lanes[4 * LANES + lane] + uy
            lanes[5 * LANES + lane] = lanes[5 * LANES + lane] + uz
            lanes[6 * LANES + lane] = cross_added(lanes[6 * LANES + lane], dy, uz, dz, uy)
            lanes[7 * LANES + lane] = cross_added(lanes[7 * LANES + lane], dz, ux, dx, uz)
            lanes[8 * LANES + lane] = cross_added(lanes[8 * LANES + lane], dx, uy, dy, ux)
            lanes[9 * LANES + lane] = added(lanes[9 * LANES + lane], wx, dx)
            lanes[10 * LANES + lane] = added(lanes[10 * LANES + lane], wy, dy)
            lanes[11 * LANES + lane] = added(lanes[11 * LANES + lane], wz, dz)
            lanes[12 * LANES + lane] = added(lanes[12 * LANES + lane], wx, dy)
            lanes[13 * LANES + lane] = added(lanes[13 * LANES + lane], wx, dz)
            lanes[14 * LANES + lane] = added(lanes[14 * LANES + lane], wy, dz)


sum_momenta = filled(momenta_rows, {"GATHERS": False})
gather_momenta = filled(momenta_rows, {"GATHERS": True})


@routine
def gather_motion(c, position, velocity, count, arrays, motions, scratch):
    """Write the rigid motion of cluster `c` into `motions`; `scratch`: MOMENTA * LANES numbers."""
    starts, firsts, slots, members = arrays.starts, arrays.firsts, arrays.slots, arrays.members
    start, entries, k = starts[c], members.size // 4, np.int64(firsts[c])
    x, y, z = position[k], position[count + k], position[2 * count + k]
    u, v, w = velocity[k], velocity[count + k], velocity[2 * count + k]
    if arrays.straight[c]:
        sum_momenta(
            (starts[c + 1] - start) // LANES, x, y, z, u, v, w, row_at(slots, start), row_at(position, k),
            row_at(position, count + k), row_at(position, 2 * count + k), row_at(velocity, k),
            row_at(velocity, count + k), row_at(velocity, 2 * count + k), row_at(members, 3 * entries + start), scratch,
        )  # fmt: skip
    else:
        gather_momenta(
            (starts[c + 1] - start) // LANES, x, y, z, u, v, w, row_at(slots, start), position, row_at(position, count),
            row_at(position, 2 * count), velocity, row_at(velocity, count), row_at(velocity, 2 * count),
            row_at(members, 3 * entries + start), scratch,
        )  # fmt: skip
    n = MOTION * c
    (
        motions[n], motions[n + 1], motions[n + 2], motions[n + 3], motions[n + 4], motions[n + 5], motions[n + 6],
        motions[n + 7], motions[n + 8],
    ) = motion(
        (lane_sum(scratch, 0), lane_sum(scratch, 1), lane_sum(scratch, 2)),
        (lane_sum(scratch, 3), lane_sum(scratch, 4), lane_sum(scratch, 5)),
        (lane_sum(scratch, 6), lane_sum(scratch, 7), lane_sum(scratch, 8)),
        (lane_sum(scratch, 9), lane_sum(scratch, 10), lane_sum(scratch, 11), lane_sum(scratch, 12), lane_sum(scratch, 13),
         lane_sum(scratch, 14)),
        arrays.centres[4 * c + 3], (x, y, z), (u, v, w),
    )  # fmt: skip


@routine
def slow(first, last, position, velocity, count, arrays):
    """Move the velocities of particles towards those of their clusters."""
    starts, clusters, factors, motions = arrays.damping
    for k in range(first, last):
        p = position[k], position[count + k], position[2 * count + k]
        v = velocity[k], velocity[count + k], velocity[2 * count + k]
        x, y, z = slowed_velocity(p, v, starts[k], starts[k + 1], clusters, factors, motions)
        velocity[k], velocity[count + k], velocity[2 * count + k] = x, y, z


@routine
def damp(team, member, bands, position, velocity, count, arrays, scratch, pitch):
    """Damp the motion within all clusters, then that of all particles; `pitch`: numbers in a band's scratch."""
    clusters = arrays.centres.size // 4
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        for c in range(clusters * band // bands, clusters * (band + 1) // bands):
            gather_motion(c, position, velocity, count, arrays, arrays.damping.motions, band_scratch)
    for band in assigned(team, member, bands):
        slow(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)


@cache
def make_damping_stage(real: Real, math: str) -> Callable:
    """Compile damp(bands, position, velocity, count, arrays, scratch, pitch)."""
    compiler = Compiler(f"bodies_damping_{np.dtype(real).name}_{math}", math)
    return compiler.team(compiler.variant_of(real).copied(damp))
