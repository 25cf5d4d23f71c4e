"""Rigid bodies that conserve their momenta up to rounding, on CPU threads (model/formulas/shape_matching/rigid.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import gather_motion
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.cpu_backend.shape_matching.layout import LONE
from softlab.cpu_backend.shape_matching.motions import motion_of
from softlab.model.base.types import Real
from softlab.model.base.variant import routine, row_routine
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.shape_matching.motions import velocity_at


@row_routine
def steady_rows(blocks, motion, x, y, z, vx, vy, vz):
    for block in range(blocks):
        for lane in range(LANES):
            k = block * LANES + lane
            vx[k], vy[k], vz[k] = velocity_at(motion, x[k], y[k], z[k])


@routine
def gather_rigid(c, position, velocity, count, arrays, scratch):
    """Write the rigid motion of cluster `c` with the momenta of its particles, which get its velocities if it is LONE."""
    if arrays.rigid.kinds[c]:
        gather_motion(c, position, velocity, count, arrays, arrays.rigid.motions, scratch)
    if arrays.rigid.kinds[c] == LONE:  # including its ghosts, which belong to no cluster
        first = np.int64(arrays.firsts[c])
        steady_rows(
            (arrays.starts[c + 1] - arrays.starts[c]) // LANES, motion_of(arrays.rigid.motions, c),
            row_at(position, first), row_at(position, count + first), row_at(position, 2 * count + first),
            row_at(velocity, first), row_at(velocity, count + first), row_at(velocity, 2 * count + first),
        )  # fmt: skip


@routine
def steady_particles(first, last, position, velocity, count, arrays):
    """Set the velocities of particles of rigid clusters that are not LONE."""
    of_rigid = arrays.rigid
    for k in range(first, last):
        for n in range(of_rigid.starts[k], of_rigid.starts[k + 1]):
            if of_rigid.factors[n] != 0.0:
                x, y, z, motion = k, count + k, 2 * count + k, motion_of(of_rigid.motions, of_rigid.clusters[n])
                velocity[x], velocity[y], velocity[z] = velocity_at(motion, position[x], position[y], position[z])


@routine
def rest_cluster(c, before, position, velocity, count, arrays):
    """Stop the rigid cluster `c` if none of its particles moved in the substep."""
    starts, slots, members = arrays.starts, arrays.slots, arrays.members
    masses = 3 * (members.size // 4)
    if arrays.rigid.kinds[c] == 0:
        return
    for e in range(starts[c], starts[c + 1]):
        if members[masses + e] != 0.0:  # not a ghost
            x, y, z = slots[e], count + slots[e], 2 * count + slots[e]
            if position[x] != before[x] or position[y] != before[y] or position[z] != before[z]:
                return
    for e in range(starts[c], starts[c + 1]):
        for axis in range(AXES):
            velocity[axis * count + slots[e]] = 0.0


@routine
def rest(band, bands, before, position, velocity, count, arrays):
    """Stop all rigid clusters of a band whose particles have not moved."""
    clusters = arrays.centres.size // 4
    for c in range(clusters * band // bands, clusters * (band + 1) // bands):
        rest_cluster(c, before, position, velocity, count, arrays)


@routine
def steady(team, member, bands, position, velocity, count, arrays, scratch, pitch):
    """Write the motions of all rigid clusters, then the velocities of all particles; `pitch`: numbers in a band's scratch."""
    clusters = arrays.centres.size // 4
    for band in assigned(team, member, bands):
        band_scratch = row_at(scratch, np.int64(pitch * band))
        for c in range(clusters * band // bands, clusters * (band + 1) // bands):
            gather_rigid(c, position, velocity, count, arrays, band_scratch)
    for band in assigned(team, member, bands):
        first, last = count * band // bands, count * (band + 1) // bands
        steady_particles(first, last, position, velocity, count, arrays)


@cache
def make_rest_stage(real: Real, math: str) -> Callable:
    """Compile rest(bands, before, position, velocity, count, arrays)."""
    compiler = Compiler(f"bodies_rest_{np.dtype(real).name}_{math}", math)
    return compiler.banded(compiler.variant_of(real).copied(rest))


@cache
def make_steadying_stage(real: Real, math: str) -> Callable:
    """Compile steady(bands, position, velocity, count, arrays, scratch, pitch)."""
    compiler = Compiler(f"bodies_rigid_{np.dtype(real).name}_{math}", math)
    return compiler.team(compiler.variant_of(real).copied(steady))
