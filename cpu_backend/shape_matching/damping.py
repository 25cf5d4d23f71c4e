"""Damping of the motion within clusters on CPU threads: clusters sum up momenta, particles approach the clusters' rigid
motions."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.motions import make_motions
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import cluster, pace
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOMENTA, MOTION


def make_lane_sum(compiler: Compiler, real: Real) -> Callable:
    """Make sum_of(lanes, n): the sum of row n, of LANES numbers."""
    total = compiler.formulas(cluster, real).total

    @compiler.compiled
    def sum_of(lanes, n):
        k = n * LANES
        return total((
            lanes[k], lanes[k + 1], lanes[k + 2], lanes[k + 3], lanes[k + 4], lanes[k + 5], lanes[k + 6], lanes[k + 7],
            lanes[k + 8], lanes[k + 9], lanes[k + 10], lanes[k + 11], lanes[k + 12], lanes[k + 13], lanes[k + 14],
            lanes[k + 15],
        ))  # fmt: skip

    return sum_of


def make_damping(compiler: Compiler, real: Real, damped: bool) -> SimpleNamespace:
    """Make `gather(c, position, velocity, count, arrays, motions, scratch)`, the rigid motion of cluster c, into
    `motions`, and `slow(first, last, position, velocity, count, arrays)`, which moves particles' velocities towards those
    of their clusters.

    `scratch`: MOMENTA * LANES numbers. Both do nothing unless `damped`.
    """
    if not damped:
        return _undamped(compiler)
    formulas, sum_of = compiler.formulas(pace, real), make_lane_sum(compiler, real)
    weighted, added, cross_added = formulas.weighted, formulas.added, formulas.cross_added
    motion, slowed, motion_of = formulas.motion, formulas.slowed, make_motions(compiler, real).motion_of
    zero = real(0)

    def make_rows(gathers: bool) -> Callable:
        def momenta_rows(blocks, x0, y0, z0, u0, v0, w0, slots, x, y, z, vx, vy, vz, mass, lanes):
            for n in range(MOMENTA * LANES):
                lanes[n] = zero
            for block in range(blocks):
                for lane in range(LANES):
                    e = block * LANES + lane
                    k, m = slots[e] if gathers else e, mass[e]
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

        momenta_rows.__name__ = "gather_momenta" if gathers else "sum_momenta"
        return compiler.row(momenta_rows)

    sum_rows, gather_rows = make_rows(False), make_rows(True)

    @compiler.compiled
    def gather(c, position, velocity, count, arrays, motions, scratch):
        starts, firsts, slots, members = arrays.starts, arrays.firsts, arrays.slots, arrays.members
        start, entries, k = starts[c], members.size // 4, np.int64(firsts[c])
        x, y, z = position[k], position[count + k], position[2 * count + k]
        u, v, w = velocity[k], velocity[count + k], velocity[2 * count + k]
        if arrays.straight[c]:
            sum_rows(
                (starts[c + 1] - start) // LANES, x, y, z, u, v, w, row_at(slots, start), row_at(position, k),
                row_at(position, count + k), row_at(position, 2 * count + k), row_at(velocity, k),
                row_at(velocity, count + k), row_at(velocity, 2 * count + k), row_at(members, 3 * entries + start), scratch,
            )  # fmt: skip
        else:
            gather_rows(
                (starts[c + 1] - start) // LANES, x, y, z, u, v, w, row_at(slots, start), position, row_at(position, count),
                row_at(position, 2 * count), velocity, row_at(velocity, count), row_at(velocity, 2 * count),
                row_at(members, 3 * entries + start), scratch,
            )  # fmt: skip
        n = MOTION * c
        (
            motions[n], motions[n + 1], motions[n + 2], motions[n + 3], motions[n + 4], motions[n + 5], motions[n + 6],
            motions[n + 7], motions[n + 8],
        ) = motion(
            (sum_of(scratch, 0), sum_of(scratch, 1), sum_of(scratch, 2)),
            (sum_of(scratch, 3), sum_of(scratch, 4), sum_of(scratch, 5)),
            (sum_of(scratch, 6), sum_of(scratch, 7), sum_of(scratch, 8)),
            (sum_of(scratch, 9), sum_of(scratch, 10), sum_of(scratch, 11), sum_of(scratch, 12), sum_of(scratch, 13),
             sum_of(scratch, 14)),
            arrays.centres[4 * c + 3], (x, y, z), (u, v, w),
        )  # fmt: skip

    @compiler.compiled
    def slow(first, last, position, velocity, count, arrays):
        starts, clusters, factors, motions = arrays.damping
        for k in range(first, last):
            px, py, pz = position[k], position[count + k], position[2 * count + k]
            vx, vy, vz = velocity[k], velocity[count + k], velocity[2 * count + k]
            x, y, z = zero, zero, zero
            for n in range(starts[k], starts[k + 1]):
                m, factor = motion_of(motions, clusters[n]), factors[n]
                dx, dy, dz = px - m.x, py - m.y, pz - m.z
                x = slowed(x, factor, m.u, m.spin_y, dz, m.spin_z, dy, vx)
                y = slowed(y, factor, m.v, m.spin_z, dx, m.spin_x, dz, vy)
                z = slowed(z, factor, m.w, m.spin_x, dy, m.spin_y, dx, vz)
            velocity[k] = vx + x
            velocity[count + k] = vy + y
            velocity[2 * count + k] = vz + z

    return SimpleNamespace(gather=gather, slow=slow)


def _undamped(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def gather(c, position, velocity, count, arrays, motions, scratch):
        pass

    @compiler.compiled
    def slow(first, last, position, velocity, count, arrays):
        pass

    return SimpleNamespace(gather=gather, slow=slow)


@cache
def make_damping_stage(real: Real, math: str) -> Callable:
    """Compile damp(bands, position, velocity, count, arrays, scratch, pitch): all clusters, then all particles, one
    parallel loop each; `pitch`: numbers in a band's scratch."""
    compiler = Compiler(f"bodies_damping_{np.dtype(real).name}_{math}", math)
    functions = make_damping(compiler, real, True)
    gather, slow = functions.gather, functions.slow

    def damp(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        clusters = arrays.centres.size // 4
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(pitch * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                gather(c, position, velocity, count, arrays, arrays.damping.motions, band_scratch)
        for band in assigned(team, member, bands):
            slow(count * band // bands, count * (band + 1) // bands, position, velocity, count, arrays)

    return compiler.team(damp)
