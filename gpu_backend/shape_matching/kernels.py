"""CUDA kernels of bodies: LANES threads sum a cluster, one thread turns it, one thread per particle sums its goals.

No atomics: a cluster's sums have the order of model/formulas/shape_matching/cluster.py, a particle's goals that of its
clusters. Particles and members of clusters are quads (rest offset and mass; in a particle's order rest offset and
factor), a cluster's frame three of them: a row of its rotation and its centre along that axis.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import predict, settle
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import add_gravity, add_particle_force, particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, inlined_routine, real, routine
from softlab.model.formulas.rotation import matrix_of, rotation_3d
from softlab.model.formulas.shape_matching.cluster import (
    LANES,
    MOMENTS,
    added,
    arrived,
    centre,
    corrected,
    total,
    weighted,
)
from softlab.model.shape_matching import motions as of_clusters
from softlab.model.shape_matching.motions import Frame, Motion

THREADS = 128  # per block
TOGETHER = THREADS // LANES  # clusters that a block sums
PITCH = LANES + 1  # of a moment's lanes in shared memory, so that threads read from different banks
SHARED = TOGETHER * MOMENTS * PITCH  # numbers per block
ONE, LANES_32, MOMENTS_32, PITCH_32 = np.int32(1), np.int32(LANES), np.int32(MOMENTS), np.int32(PITCH)
NO_STEP = np.int64(0)  # no force on bodies depends on it


@inlined_routine
def lane_sum(shared, k):
    """Return the sum of the LANES numbers from index `k` on, in the fixed order of `cluster.total`."""
    return total((
        shared[k], shared[k + 1], shared[k + 2], shared[k + 3], shared[k + 4], shared[k + 5], shared[k + 6],
        shared[k + 7], shared[k + 8], shared[k + 9], shared[k + 10], shared[k + 11], shared[k + 12],
        shared[k + 13], shared[k + 14], shared[k + 15],
    ))  # fmt: skip


@routine
def sum_up(position, starts, firsts, indices, members, sums):
    """Write the moments of all clusters; in blocks of THREADS."""
    shared = cuda.shared.array(SHARED, real)
    lane, place = np.int32(cuda.threadIdx.x % LANES_32), np.int32(cuda.threadIdx.x // LANES_32)
    c = np.int32(cuda.blockIdx.x * TOGETHER + place)
    clusters = np.int32(firsts.size)
    x, y, z = 0.0, 0.0, 0.0
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if c < clusters:
        first = load_quad(position, firsts[c])
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            p, m = load_quad(position, indices[e]), load_quad(members, e)
            wx, wy, wz = (
                weighted(m[3], p[0], first[0]), weighted(m[3], p[1], first[1]), weighted(m[3], p[2], first[2]),
            )  # fmt: skip
            x, y, z = x + wx, y + wy, z + wz
            xx, xy, xz = added(xx, wx, m[0]), added(xy, wx, m[1]), added(xz, wx, m[2])
            yx, yy, yz = added(yx, wy, m[0]), added(yy, wy, m[1]), added(yz, wy, m[2])
            zx, zy, zz = added(zx, wz, m[0]), added(zy, wz, m[1]), added(zz, wz, m[2])
    base = np.int32(place * MOMENTS_32 * PITCH_32)
    at = np.int32(base + lane)
    shared[at], shared[at + PITCH_32], shared[at + 2 * PITCH_32] = x, y, z
    shared[at + 3 * PITCH_32], shared[at + 4 * PITCH_32], shared[at + 5 * PITCH_32] = xx, xy, xz
    shared[at + 6 * PITCH_32], shared[at + 7 * PITCH_32], shared[at + 8 * PITCH_32] = yx, yy, yz
    shared[at + 9 * PITCH_32], shared[at + 10 * PITCH_32], shared[at + 11 * PITCH_32] = zx, zy, zz
    cuda.syncthreads()
    if c < clusters and lane < MOMENTS_32:
        k = np.int32(base + lane * PITCH_32)
        sums[c * MOMENTS_32 + lane] = lane_sum(shared, k)


@routine
def turn(position, firsts, leans, sums, rotation, new_rotation, frames):
    """Write the rotations of all clusters, from `rotation` into `new_rotation`, and their frames."""
    c = np.int32(cuda.grid(1))
    if c < firsts.size:
        first, q, k = load_quad(position, firsts[c]), load_quad(rotation, c), np.int32(MOMENTS_32 * c)
        rest_offset, wx, wy, wz = load_quad(leans, c), sums[k], sums[k + 1], sums[k + 2]
        moments_at_rest = (
            corrected(sums[k + 3], wx, rest_offset[0]), corrected(sums[k + 4], wx, rest_offset[1]),
            corrected(sums[k + 5], wx, rest_offset[2]), corrected(sums[k + 6], wy, rest_offset[0]),
            corrected(sums[k + 7], wy, rest_offset[1]), corrected(sums[k + 8], wy, rest_offset[2]),
            corrected(sums[k + 9], wz, rest_offset[0]), corrected(sums[k + 10], wz, rest_offset[1]),
            corrected(sums[k + 11], wz, rest_offset[2]),
        )  # fmt: skip
        w, x, y, z = rotation_3d(moments_at_rest, (q[0], q[1], q[2], q[3]))
        store_quad(new_rotation, c, w, x, y, z)
        xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix_of(w, x, y, z)
        row, mass, a, b, d = np.int32(ROWS * c), rest_offset[3], rest_offset[0], rest_offset[1], rest_offset[2]
        store_quad(frames, row, xx, xy, xz, centre(first[0], wx, mass, xx, xy, xz, a, b, d))
        store_quad(frames, row + 1, yx, yy, yz, centre(first[1], wy, mass, yx, yy, yz, a, b, d))
        store_quad(frames, row + 2, zx, zy, zz, centre(first[2], wz, mass, zx, zy, zz, a, b, d))


@inlined_routine
def frame_of(frames, c):
    row = np.int32(ROWS * c)
    a, b, d = load_quad(frames, row), load_quad(frames, row + 1), load_quad(frames, row + 2)
    return Frame(a[0], a[1], a[2], b[0], b[1], b[2], d[0], d[1], d[2], a[3], b[3], d[3])


@inlined_routine
def motion_of(motions, c):
    row = np.int32(ROWS * c)
    o, t, s = load_quad(motions, row), load_quad(motions, row + 1), load_quad(motions, row + 2)
    return Motion(o[0], o[1], o[2], t[0], t[1], t[2], s[0], s[1], s[2])


@inlined_routine
def member_of(members, n):
    return load_quad(members, n)


displacement_to_goals = filled(of_clusters.displacement_to_goals, {"frame_of": frame_of, "member_of": member_of})
slowed_velocity = filled(of_clusters.slowed_velocity, {"motion_of": motion_of})


@inlined_routine
def move_mass(p, k, particle_starts, particle_clusters, particle_members, frames):
    """Return the position of particle `k` at `p`, moved towards its goals."""
    first, last = particle_starts[k], particle_starts[k + ONE]
    x, y, z = displacement_to_goals(p, first, last, particle_clusters, particle_members, frames)
    return arrived(p[0], x), arrived(p[1], y), arrived(p[2], z)


@routine
def move(position, particle_starts, particle_clusters, particle_members, frames):
    """Move the particles towards their goals, in place."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        x, y, z = move_mass(p, k, particle_starts, particle_clusters, particle_members, frames)
        store_quad(position, k, x, y, z, p[3])


@routine
def begin(position, velocity, predicted, record, integers):
    """Predict the particles at the start of a substep."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = add_gravity(0.0, 0.0, 0.0, parameters)
        ax, ay, az = add_particle_force(ax, ay, az, k, p[3], parameters, integers, NO_STEP)
        x, y, z = predict(p, v, ax, ay, az, parameters)
        store_quad(predicted, k, x, y, z, p[3])


@routine
def finish(
    before, position, velocity, particle_starts, particle_clusters, particle_members, frames, record, bodies,
    integers, counter, place, substeps, substep,
):  # fmt: skip
    """End a substep: the last iteration's displacement to the goals, velocities, colliders."""
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p = load_quad(before, k), load_quad(position, k)
        x, y, z = move_mass(p, k, particle_starts, particle_clusters, particle_members, frames)
        px, py, pz, vx, vy, vz = settle(b, (x, y, z, p[3]), world, number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_bodies_clusters(real: Real, math: str) -> SimpleNamespace:
    """Compile `sum_up`, `turn` and `move`."""
    return kernels_of(device_variant(real, math), math, (sum_up, turn, move), f"bodies_{variant_name(real, math)}")


@cache
def make_bodies_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `begin` and `finish`, start and end of a substep."""
    variant, kernels = device_variant(real, math, particle_features(parts)), (with_forces(begin, parts), finish)
    return kernels_of(variant, math, kernels, f"bodies_{variant_name(real, math, parts)}")
