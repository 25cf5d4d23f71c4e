"""Rigid bodies that conserve their momenta up to rounding, on CPU threads (model/formulas/shape_matching/rigid.py)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.shape_matching.damping import make_damping
from softlab.cpu_backend.shape_matching.kernels import AXES
from softlab.cpu_backend.shape_matching.layout import LONE
from softlab.cpu_backend.shape_matching.motions import make_motions
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching.cluster import LANES


def make_steadying(compiler: Compiler, real: Real, has_rigid: bool) -> SimpleNamespace:
    """Make `gather` and `steady`; they do nothing unless `has_rigid`.

    `gather(c, position, velocity, count, arrays, scratch)`: the rigid motion of cluster c with the momenta of its
    particles, which get its velocities if it is LONE; `steady(first, last, position, velocity, count, arrays)`:
    velocities of other particles.
    """
    if not has_rigid:
        return _without(compiler)
    of_motions, zero = make_motions(compiler, real), real(0)
    motion_of, velocity_at = of_motions.motion_of, of_motions.velocity_at
    gather_motion = make_damping(compiler, real, True).gather

    @compiler.row
    def steady_rows(blocks, motion, x, y, z, vx, vy, vz):
        for block in range(blocks):
            for lane in range(LANES):
                k = block * LANES + lane
                vx[k], vy[k], vz[k] = velocity_at(motion, x[k], y[k], z[k])

    @compiler.compiled
    def gather(c, position, velocity, count, arrays, scratch):
        if arrays.rigid.kinds[c]:
            gather_motion(c, position, velocity, count, arrays, arrays.rigid.motions, scratch)
        if arrays.rigid.kinds[c] == LONE:  # including its ghosts, which belong to no cluster
            first = np.int64(arrays.firsts[c])
            steady_rows(
                (arrays.starts[c + 1] - arrays.starts[c]) // LANES, motion_of(arrays.rigid.motions, c),
                row_at(position, first), row_at(position, count + first), row_at(position, 2 * count + first),
                row_at(velocity, first), row_at(velocity, count + first), row_at(velocity, 2 * count + first),
            )  # fmt: skip

    @compiler.compiled
    def steady(first, last, position, velocity, count, arrays):
        of_rigid = arrays.rigid
        for k in range(first, last):
            for n in range(of_rigid.starts[k], of_rigid.starts[k + 1]):
                if of_rigid.factors[n] != zero:
                    x, y, z, motion = k, count + k, 2 * count + k, motion_of(of_rigid.motions, of_rigid.clusters[n])
                    velocity[x], velocity[y], velocity[z] = velocity_at(motion, position[x], position[y], position[z])

    return SimpleNamespace(gather=gather, steady=steady)


def _without(compiler: Compiler) -> SimpleNamespace:
    @compiler.compiled
    def gather(c, position, velocity, count, arrays, scratch):
        pass

    @compiler.compiled
    def steady(first, last, position, velocity, count, arrays):
        pass

    return SimpleNamespace(gather=gather, steady=steady)


@cache
def make_rest(compiler: Compiler, real: Real, rests: bool) -> Callable:
    """Make rest(c, before, position, velocity, count, arrays): stop the rigid cluster c if none of its particles moved
    in the substep. It does nothing unless a body `rests`."""
    zero = real(0)

    @compiler.compiled
    def rest(c, before, position, velocity, count, arrays):
        if not rests:
            return
        starts, slots, members = arrays.starts, arrays.slots, arrays.members
        masses = 3 * (members.size // 4)
        if arrays.rigid.kinds[c] == 0:
            return
        for e in range(starts[c], starts[c + 1]):
            if members[masses + e] != zero:  # not a ghost
                x, y, z = slots[e], count + slots[e], 2 * count + slots[e]
                if position[x] != before[x] or position[y] != before[y] or position[z] != before[z]:
                    return
        for e in range(starts[c], starts[c + 1]):
            for axis in range(AXES):
                velocity[axis * count + slots[e]] = zero

    return rest


@cache
def make_rest_stage(real: Real, math: str) -> Callable:
    """Compile rest(bands, before, position, velocity, count, arrays): all clusters, in parallel."""
    compiler = Compiler(f"bodies_rest_{np.dtype(real).name}_{math}", math)
    rest_one = make_rest(compiler, real, True)

    def rest(band, bands, before, position, velocity, count, arrays):
        clusters = arrays.centres.size // 4
        for c in range(clusters * band // bands, clusters * (band + 1) // bands):
            rest_one(c, before, position, velocity, count, arrays)

    return compiler.banded(rest)


@cache
def make_steadying_stage(real: Real, math: str) -> Callable:
    """Compile steady(bands, position, velocity, count, arrays, scratch, pitch): all clusters, then all particles, one
    parallel loop each; `pitch`: numbers in a band's scratch."""
    compiler = Compiler(f"bodies_rigid_{np.dtype(real).name}_{math}", math)
    functions = make_steadying(compiler, real, True)
    gather, steady_some = functions.gather, functions.steady

    def steady(team, member, bands, position, velocity, count, arrays, scratch, pitch):
        clusters = arrays.centres.size // 4
        for band in assigned(team, member, bands):
            band_scratch = row_at(scratch, np.int64(pitch * band))
            for c in range(clusters * band // bands, clusters * (band + 1) // bands):
                gather(c, position, velocity, count, arrays, band_scratch)
        for band in assigned(team, member, bands):
            first, last = count * band // bands, count * (band + 1) // bands
            steady_some(first, last, position, velocity, count, arrays)

    return compiler.team(steady)
