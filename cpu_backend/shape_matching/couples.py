"""Moments of friction between particles, on CPU threads: clusters sum them up and turn, and particles turn with them
(model/formulas/shape_matching/couple.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.kernels import lane_sum
from softlab.cpu_backend.shape_matching.motions import rotated
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, routine, row_routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.couple import SPIN, SUMS, spin
from softlab.model.formulas.shape_matching.pace import added, weighted
from softlab.model.formulas.shape_matching.rigid import carried


@row_routine
def couple_rows(blocks, x0, y0, z0, slots, x, y, z, cx, cy, cz, mass, lanes):
    for n in range(SUMS * LANES):
        lanes[n] = 0.0
    for block in range(blocks):
        for lane in range(LANES):
            e = block * LANES + lane
            k, m = slots[e], mass[e]
            dx, dy, dz = x[k] - x0, y[k] - y0, z[k] - z0
            wx, wy, wz = weighted(m, x[k], x0), weighted(m, y[k], y0), weighted(m, z[k], z0)
            lanes[lane] = lanes[lane] + wx
            lanes[LANES + lane] = lanes[LANES + lane] + wy
            lanes[2 * LANES + lane] = lanes[2 * LANES + lane] + wz
            lanes[3 * LANES + lane] = added(lanes[3 * LANES + lane], m, cx[k])
            lanes[4 * LANES + lane] = added(lanes[4 * LANES + lane], m, cy[k])
            lanes[5 * LANES + lane] = added(lanes[5 * LANES + lane], m, cz[k])
            lanes[6 * LANES + lane] = added(lanes[6 * LANES + lane], wx, dx)
            lanes[7 * LANES + lane] = added(lanes[7 * LANES + lane], wy, dy)
            lanes[8 * LANES + lane] = added(lanes[8 * LANES + lane], wz, dz)
            lanes[9 * LANES + lane] = added(lanes[9 * LANES + lane], wx, dy)
            lanes[10 * LANES + lane] = added(lanes[10 * LANES + lane], wx, dz)
            lanes[11 * LANES + lane] = added(lanes[11 * LANES + lane], wy, dz)


@routine
def is_coupled(c, count, arrays):
    """Return True if a particle of cluster `c` has a couple."""
    starts, slots, couples = arrays.couples.entries.starts, arrays.couples.entries.slots, arrays.couples.sums
    for e in range(starts[c], starts[c + 1]):
        k = slots[e]
        if couples[k] != 0.0 or couples[count + k] != 0.0 or couples[2 * count + k] != 0.0:
            return True
    return False


@routine
def gather_couples(c, position, count, arrays, scratch):
    """Write the rotation of cluster `c` due to its couples."""
    spins, n = arrays.couples.spins, SPIN * c
    if not is_coupled(c, count, arrays):
        for number in range(SPIN):
            spins[n + number] = 0.0
        return
    couples, entries = arrays.couples.sums, arrays.couples.entries
    starts, slots, members = entries.starts, entries.slots, entries.members
    start, masses, k = starts[c], 3 * (members.size // 4), np.int64(entries.firsts[c])
    x, y, z = position[k], position[count + k], position[2 * count + k]
    couple_rows(
        (starts[c + 1] - start) // LANES, x, y, z, row_at(slots, start), position, row_at(position, count),
        row_at(position, 2 * count), couples, row_at(couples, count), row_at(couples, 2 * count),
        row_at(members, masses + start), scratch,
    )  # fmt: skip
    spins[n], spins[n + 1], spins[n + 2], spins[n + 3], spins[n + 4], spins[n + 5] = spin(
        (lane_sum(scratch, 0), lane_sum(scratch, 1), lane_sum(scratch, 2)),
        (lane_sum(scratch, 3), lane_sum(scratch, 4), lane_sum(scratch, 5)),
        (lane_sum(scratch, 6), lane_sum(scratch, 7), lane_sum(scratch, 8), lane_sum(scratch, 9), lane_sum(scratch, 10),
         lane_sum(scratch, 11)),
        entries.centres[4 * c + 3], (x, y, z),
    )  # fmt: skip


@routine
def turn_particles(first, last, position, travel, weights, count, arrays):
    """Rotate particles with their clusters and set their couples to 0."""
    starts, clusters, cluster_weights, spins, couples, _ = arrays.couples
    for i in range(first, last):
        j, k = count + i, 2 * count + i
        couples[i], couples[j], couples[k] = 0.0, 0.0, 0.0
        if weights[i] == 0.0:
            continue
        p = position[i], position[j], position[k]
        x, y, z = rotated(p, True, starts[i], starts[i + 1], clusters, cluster_weights, spins)
        if FEATURE.rigid_motion:
            travel[i], travel[j] = carried(travel[i], x, position[i]), carried(travel[j], y, position[j])
            travel[k] = carried(travel[k], z, position[k])
        position[i], position[j], position[k] = x, y, z


@routine
def turn(team, member, bands, position, travel, weights, count, arrays, scratch, pitch):
    """Rotate all clusters, then all particles; `pitch`: numbers in a band's scratch."""
    clusters = arrays.couples.entries.centres.size // 4
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        for c in range(clusters * band // bands, clusters * (band + 1) // bands):
            gather_couples(c, position, count, arrays, band_scratch)
    for band in assigned(team, member, bands):
        turn_particles(count * band // bands, count * (band + 1) // bands, position, travel, weights, count, arrays)


@cache
def make_couples_stage(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile turn(bands, position, travel, weights, count, arrays, scratch, pitch)."""
    compiler = Compiler(f"bodies_couples_{np.dtype(real).name}_{math}{'_rigid' * ('rigid-motion' in parts)}", math)
    return compiler.team(compiler.variant_of(real, features_of(parts & {"rigid-motion"})).copied(turn))
