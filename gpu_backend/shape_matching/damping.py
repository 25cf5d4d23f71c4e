"""CUDA kernels that damp the motion within clusters: LANES threads sum a cluster's momenta, one computes its rigid
motion, one thread per particle approaches those of its clusters. model/formulas/shape_matching/cluster.py has the order
of sums."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import AXES, ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.shape_matching.kernels import PITCH, TOGETHER, make_lane_sum, make_move
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import pace
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.pace import MOMENTA

SHARED = TOGETHER * MOMENTA * PITCH  # numbers per block


@cache
def make_gather(real: Real, math: str) -> Kernel:
    """Compile gather(position, velocity, starts, firsts, indices, members, leans, motions): the rigid motions of all
    clusters, in blocks of THREADS. `motions`: three quads each, the centre, the velocity there, the spin."""
    formulas, lane_sum = device_formulas(pace, real, math), make_lane_sum(real, math)
    weighted, added, cross_added, motion = formulas.weighted, formulas.added, formulas.cross_added, formulas.motion
    zero, one, lanes, momenta, pitch = real(0), np.int32(1), np.int32(LANES), np.int32(MOMENTA), np.int32(PITCH)

    def gather(position, velocity, starts, firsts, indices, members, leans, motions):
        shared = cuda.shared.array(SHARED, real)
        lane, place = np.int32(cuda.threadIdx.x % lanes), np.int32(cuda.threadIdx.x // lanes)
        c = np.int32(cuda.blockIdx.x * TOGETHER + place)
        clusters = np.int32(firsts.size)
        x, y, z, u, v, w, lx, ly, lz = zero, zero, zero, zero, zero, zero, zero, zero, zero
        xx, yy, zz, xy, xz, yz = zero, zero, zero, zero, zero, zero
        if c < clusters:
            f, g = load_quad(position, firsts[c]), load_quad(velocity, firsts[c])
            for e in range(np.int32(starts[c] + lane), starts[c + one], lanes):
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
        base = np.int32(place * momenta * pitch)
        at = np.int32(base + lane)
        shared[at], shared[at + pitch], shared[at + 2 * pitch] = x, y, z
        shared[at + 3 * pitch], shared[at + 4 * pitch], shared[at + 5 * pitch] = u, v, w
        shared[at + 6 * pitch], shared[at + 7 * pitch], shared[at + 8 * pitch] = lx, ly, lz
        shared[at + 9 * pitch], shared[at + 10 * pitch], shared[at + 11 * pitch] = xx, yy, zz
        shared[at + 12 * pitch], shared[at + 13 * pitch], shared[at + 14 * pitch] = xy, xz, yz
        cuda.syncthreads()
        if lane < momenta:
            k = np.int32(base + lane * pitch)
            shared[k] = lane_sum(shared, k)
        cuda.syncthreads()
        if c < clusters and lane == 0:
            f, g, rest_offset, row = (
                load_quad(position, firsts[c]), load_quad(velocity, firsts[c]), load_quad(leans, c), ROWS * c,
            )  # fmt: skip
            cx, cy, cz, vx, vy, vz, ox, oy, oz = motion(
                (shared[base], shared[base + pitch], shared[base + 2 * pitch]),
                (shared[base + 3 * pitch], shared[base + 4 * pitch], shared[base + 5 * pitch]),
                (shared[base + 6 * pitch], shared[base + 7 * pitch], shared[base + 8 * pitch]),
                (shared[base + 9 * pitch], shared[base + 10 * pitch], shared[base + 11 * pitch], shared[base + 12 * pitch],
                 shared[base + 13 * pitch], shared[base + 14 * pitch]),
                rest_offset[3], (f[0], f[1], f[2]), (g[0], g[1], g[2]),
            )  # fmt: skip
            store_quad(motions, row, cx, cy, cz, zero)
            store_quad(motions, row + 1, vx, vy, vz, zero)
            store_quad(motions, row + 2, ox, oy, oz, zero)

    return make_kernel(gather, f"bodies_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_slow(real: Real, math: str) -> Callable:
    """Make slow_mass(p, v, k, particle_starts, particle_clusters, slowing, motions) -> (vx, vy, vz): particle k at p with
    velocity v."""
    slowed, zero, one = device_formulas(pace, real, math).slowed, real(0), np.int32(1)

    @inlined(math)
    def slow_mass(p, v, k, particle_starts, particle_clusters, slowing, motions):
        x, y, z = zero, zero, zero
        for n in range(particle_starts[k], particle_starts[k + one]):
            row, factor = np.int32(ROWS * particle_clusters[n]), slowing[n]
            c, u, o = load_quad(motions, row), load_quad(motions, row + 1), load_quad(motions, row + 2)
            dx, dy, dz = p[0] - c[0], p[1] - c[1], p[2] - c[2]
            x = slowed(x, factor, u[0], o[1], dz, o[2], dy, v[0])
            y = slowed(y, factor, u[1], o[2], dx, o[0], dz, v[1])
            z = slowed(z, factor, u[2], o[0], dy, o[1], dx, v[2])
        return v[0] + x, v[1] + y, v[2] + z

    return slow_mass


@cache
def make_damping_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the kernels that end a substep with damped clusters, before and after `gather`: `rate`, `slow`, `finish`.

    `rate(before, position, velocity, particle_starts, particle_clusters, particle_members, frames, parameters)`: the
    last iteration's displacement to the goals, and velocities; `slow(position, velocity, particle_starts,
    particle_clusters, slowing, motions)`; and `finish(before, position, velocity, particle_starts, particle_clusters,
    slowing, motions, record, bodies, integers, counter, place, substeps, substep)`, the same and colliders.
    """
    points = make_motion(real, math, parts, AXES)
    rate_of, collide = points.rate_of, points.collide
    move_mass, slow_mass, clock, zero = make_move(real, math), make_slow(real, math), make_clock(math, parts), real(0)

    def rate(before, position, velocity, particle_starts, particle_clusters, particle_members, frames, record):
        parameters = record[0]
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            b, p = load_quad(before, k), load_quad(position, k)
            x, y, z = move_mass(p, k, particle_starts, particle_clusters, particle_members, frames)
            vx, vy, vz = rate_of((x, y, z, p[3]), b, parameters)
            store_quad(position, k, x, y, z, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    def slow(position, velocity, particle_starts, particle_clusters, slowing, motions):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v = load_quad(position, k), load_quad(velocity, k)
            vx, vy, vz = slow_mass(p, v, k, particle_starts, particle_clusters, slowing, motions)
            store_quad(velocity, k, vx, vy, vz, zero)

    def finish(
        before, position, velocity, particle_starts, particle_clusters, slowing, motions, record, bodies, integers,
        counter, place, substeps, substep,
    ):  # fmt: skip
        world = World(record[0], bodies, integers)
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            _, number = clock(counter, place, substeps, substep)
            b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
            vx, vy, vz = slow_mass(p, v, k, particle_starts, particle_clusters, slowing, motions)
            px, py, pz, vx, vy, vz = collide(b, p, vx, vy, vz, world, number)
            store_quad(position, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    variant = f"bodies_damping_{variant_name(real, math, parts)}"
    return make_kernels((rate, slow, finish), variant, **kernel_options(math))
