"""CUDA kernels that damp the motion within clusters: LANES threads sum a cluster's momenta, one computes its rigid
motion, one thread per particle approaches those of its clusters. model/formulas/shape_matching/cluster.py has the order
of sums."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide, rate_of
from softlab.gpu_backend.core.compile import Kernel, kernel_options, kernels_of, make_kernel, variant_name
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.shape_matching.kernels import (
    LANES_32,
    ONE,
    PITCH,
    PITCH_32,
    TOGETHER,
    lane_sum,
    move_mass,
    slowed_velocity,
)
from softlab.model.base.types import Real
from softlab.model.base.variant import real, routine
from softlab.model.formulas.shape_matching.pace import MOMENTA, added, cross_added, motion, weighted

SHARED = TOGETHER * MOMENTA * PITCH  # numbers per block
MOMENTA_32 = np.int32(MOMENTA)


@routine
def gather(position, velocity, starts, firsts, indices, members, leans, motions):
    """Write the rigid motions of all clusters; in blocks of THREADS. `motions`: three quads each, the centre, the velocity
    there, the spin."""
    shared = cuda.shared.array(SHARED, real)
    lane, place = np.int32(cuda.threadIdx.x % LANES_32), np.int32(cuda.threadIdx.x // LANES_32)
    c = np.int32(cuda.blockIdx.x * TOGETHER + place)
    clusters = np.int32(firsts.size)
    x, y, z, u, v, w, lx, ly, lz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if c < clusters:
        f, g = load_quad(position, firsts[c]), load_quad(velocity, firsts[c])
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            p, q, m = load_quad(position, indices[e]), load_quad(velocity, indices[e]), load_quad(members, e)
            dx, dy, dz = p[0] - f[0], p[1] - f[1], p[2] - f[2]
            wx, wy, wz = weighted(m[3], p[0], f[0]), weighted(m[3], p[1], f[1]), weighted(m[3], p[2], f[2])
            ux, uy, uz = weighted(m[3], q[0], g[0]), weighted(m[3], q[1], g[1]), weighted(m[3], q[2], g[2])
            x, y, z, u, v, w = x + wx, y + wy, z + wz, u + ux, v + uy, w + uz
            lx, ly, lz = (
                cross_added(lx, dy, uz, dz, uy),
                cross_added(ly, dz, ux, dx, uz),
                cross_added(lz, dx, uy, dy, ux),
            )
            xx, yy, zz = added(xx, wx, dx), added(yy, wy, dy), added(zz, wz, dz)
            xy, xz, yz = added(xy, wx, dy), added(xz, wx, dz), added(yz, wy, dz)
    base = np.int32(place * MOMENTA_32 * PITCH_32)
    at = np.int32(base + lane)
    shared[at], shared[at + PITCH_32], shared[at + 2 * PITCH_32] = x, y, z
    shared[at + 3 * PITCH_32], shared[at + 4 * PITCH_32], shared[at + 5 * PITCH_32] = u, v, w
    shared[at + 6 * PITCH_32], shared[at + 7 * PITCH_32], shared[at + 8 * PITCH_32] = lx, ly, lz
    shared[at + 9 * PITCH_32], shared[at + 10 * PITCH_32], shared[at + 11 * PITCH_32] = xx, yy, zz
    shared[at + 12 * PITCH_32], shared[at + 13 * PITCH_32], shared[at + 14 * PITCH_32] = xy, xz, yz
    cuda.syncthreads()
    if lane < MOMENTA_32:
        k = np.int32(base + lane * PITCH_32)
        shared[k] = lane_sum(shared, k)
    cuda.syncthreads()
    if c < clusters and lane == 0:
        f, g, rest_offset, row = (
            load_quad(position, firsts[c]), load_quad(velocity, firsts[c]), load_quad(leans, c), ROWS * c,
        )  # fmt: skip
        cx, cy, cz, vx, vy, vz, ox, oy, oz = motion(
            (shared[base], shared[base + PITCH_32], shared[base + 2 * PITCH_32]),
            (shared[base + 3 * PITCH_32], shared[base + 4 * PITCH_32], shared[base + 5 * PITCH_32]),
            (shared[base + 6 * PITCH_32], shared[base + 7 * PITCH_32], shared[base + 8 * PITCH_32]),
            (shared[base + 9 * PITCH_32], shared[base + 10 * PITCH_32], shared[base + 11 * PITCH_32],
             shared[base + 12 * PITCH_32], shared[base + 13 * PITCH_32], shared[base + 14 * PITCH_32]),
            rest_offset[3], (f[0], f[1], f[2]), (g[0], g[1], g[2]),
        )  # fmt: skip
        store_quad(motions, row, cx, cy, cz, 0.0)
        store_quad(motions, row + 1, vx, vy, vz, 0.0)
        store_quad(motions, row + 2, ox, oy, oz, 0.0)


@routine
def rate(before, position, velocity, particle_starts, particle_clusters, particle_members, frames, record):
    """Do the last iteration's displacement to the goals, and write velocities."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p = load_quad(before, k), load_quad(position, k)
        x, y, z = move_mass(p, k, particle_starts, particle_clusters, particle_members, frames)
        vx, vy, vz = rate_of((x, y, z, p[3]), b, parameters)
        store_quad(position, k, x, y, z, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def slow(position, velocity, particle_starts, particle_clusters, slowing, motions):
    """Move the velocities of particles towards those of their clusters."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v = load_quad(position, k), load_quad(velocity, k)
        first, last = particle_starts[k], particle_starts[k + ONE]
        vx, vy, vz = slowed_velocity(p, v, first, last, particle_clusters, slowing, motions)
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def finish(
    before, position, velocity, particle_starts, particle_clusters, slowing, motions, record, bodies, integers,
    counter, place, substeps, substep,
):  # fmt: skip
    """Do the same, and colliders."""
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
        first, last = particle_starts[k], particle_starts[k + ONE]
        vx, vy, vz = slowed_velocity(p, v, first, last, particle_clusters, slowing, motions)
        px, py, pz, vx, vy, vz = collide(b, p, vx, vy, vz, world, number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_gather(real: Real, math: str) -> Kernel:
    """Compile gather(position, velocity, starts, firsts, indices, members, leans, motions)."""
    kernel = device_variant(real, math).copied(gather)
    return make_kernel(kernel, f"bodies_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_damping_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the kernels that end a substep with damped clusters, before and after `gather`: `rate`, `slow`, `finish`."""
    variant = device_variant(real, math, particle_features(parts))
    return kernels_of(variant, math, (rate, slow, finish), f"bodies_damping_{variant_name(real, math, parts)}")
