"""CUDA kernels of the moments of friction between particles (model/formulas/shape_matching/couple.py): LANES threads
sum those of a cluster, one computes its turn, one thread per particle turns with its clusters."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.shape_matching.kernels import PITCH, THREADS, TOGETHER, make_lane_sum
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import couple, pace, rigid
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.couple import SUMS

SHARED = TOGETHER * SUMS * PITCH  # numbers per block
QUADS = 2  # per cluster: its centre, its turn


@cache
def make_couples(real: Real, math: str, has_rigid: bool) -> SimpleNamespace:
    """Compile `gather` and `turn`.

    `gather(position, couples, starts, firsts, indices, members, leans, spins)`: the turns of all clusters, in blocks of
    THREADS; `turn(position, couples, particle_starts, particle_clusters, particle_weights, spins)`: moves particles and
    zeroes their couples; with rigid bodies, `has_rigid`, its last argument is their `travel`.
    """
    masses, formulas = device_formulas(pace, real, math), device_formulas(couple, real, math)
    lane_sum, carried = make_lane_sum(real, math), device_formulas(rigid, real, math).carried
    weighted, added, spin, cross_added, gone = (
        masses.weighted,
        masses.added,
        formulas.spin,
        formulas.cross_added,
        formulas.gone,
    )
    zero, one, lanes, sums, pitch = real(0), np.int32(1), np.int32(LANES), np.int32(SUMS), np.int32(PITCH)

    def gather(position, couples, starts, firsts, indices, members, leans, spins):
        shared = cuda.shared.array(SHARED, real)
        lane, place = np.int32(cuda.threadIdx.x % lanes), np.int32(cuda.threadIdx.x // lanes)
        c = np.int32(cuda.blockIdx.x * TOGETHER + place)
        clusters = np.int32(firsts.size)
        x, y, z, u, v, w = zero, zero, zero, zero, zero, zero
        xx, yy, zz, xy, xz, yz = zero, zero, zero, zero, zero, zero
        if c < clusters:
            f = load_quad(position, firsts[c])
            for e in range(np.int32(starts[c] + lane), starts[c + one], lanes):
                p, q, m = load_quad(position, indices[e]), load_quad(couples, indices[e]), load_quad(members, e)
                dx, dy, dz = p[0] - f[0], p[1] - f[1], p[2] - f[2]
                wx, wy, wz = weighted(m[3], p[0], f[0]), weighted(m[3], p[1], f[1]), weighted(m[3], p[2], f[2])
                x, y, z = x + wx, y + wy, z + wz
                u, v, w = added(u, m[3], q[0]), added(v, m[3], q[1]), added(w, m[3], q[2])
                xx, yy, zz = added(xx, wx, dx), added(yy, wy, dy), added(zz, wz, dz)
                xy, xz, yz = added(xy, wx, dy), added(xz, wx, dz), added(yz, wy, dz)
        base = np.int32(place * sums * pitch)
        at = np.int32(base + lane)
        shared[at], shared[at + pitch], shared[at + 2 * pitch] = x, y, z
        shared[at + 3 * pitch], shared[at + 4 * pitch], shared[at + 5 * pitch] = u, v, w
        shared[at + 6 * pitch], shared[at + 7 * pitch], shared[at + 8 * pitch] = xx, yy, zz
        shared[at + 9 * pitch], shared[at + 10 * pitch], shared[at + 11 * pitch] = xy, xz, yz
        cuda.syncthreads()
        if lane < sums:
            k = np.int32(base + lane * pitch)
            shared[k] = lane_sum(shared, k)
        cuda.syncthreads()
        if c < clusters and lane == 0:
            f, rest_offset, row = load_quad(position, firsts[c]), load_quad(leans, c), np.int32(QUADS * c)
            cx, cy, cz, ox, oy, oz = spin(
                (shared[base], shared[base + pitch], shared[base + 2 * pitch]),
                (shared[base + 3 * pitch], shared[base + 4 * pitch], shared[base + 5 * pitch]),
                (shared[base + 6 * pitch], shared[base + 7 * pitch], shared[base + 8 * pitch], shared[base + 9 * pitch],
                 shared[base + 10 * pitch], shared[base + 11 * pitch]),
                rest_offset[3], (f[0], f[1], f[2]),
            )  # fmt: skip
            store_quad(spins, row, cx, cy, cz, zero)
            store_quad(spins, row + 1, ox, oy, oz, zero)

    @inlined(math)
    def turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins):
        """Return (old position, new position) of particle k."""
        store_quad(couples, k, zero, zero, zero, zero)
        p, x, y, z = load_quad(position, k), zero, zero, zero
        if p[3] != zero:
            for n in range(particle_starts[k], particle_starts[k + one]):
                row, weight = np.int32(QUADS * particle_clusters[n]), particle_weights[n]
                c, o = load_quad(spins, row), load_quad(spins, row + 1)
                dx, dy, dz = p[0] - c[0], p[1] - c[1], p[2] - c[2]
                x = cross_added(x, weight, o[1], dz, o[2], dy)
                y = cross_added(y, weight, o[2], dx, o[0], dz)
                z = cross_added(z, weight, o[0], dy, o[1], dx)
        x, y, z = gone(p[0], x), gone(p[1], y), gone(p[2], z)
        store_quad(position, k, x, y, z, p[3])
        return p, (x, y, z)

    def turn_soft(position, couples, particle_starts, particle_clusters, particle_weights, spins):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins)

    def turn_rigid(position, couples, particle_starts, particle_clusters, particle_weights, spins, travel):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, q = turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins)
            t = load_quad(travel, k)
            store_quad(travel, k, carried(t[0], q[0], p[0]), carried(t[1], q[1], p[1]), carried(t[2], q[2], p[2]), t[3])

    turn = turn_rigid if has_rigid else turn_soft
    turn.__name__ = "turn"
    name = f"bodies_couples_{variant_name(real, math, 'rigid' * has_rigid)}"
    return make_kernels((gather, turn), name, **kernel_options(math))


class Couples:
    """Couples of `clusters`, with their device arrays: entries, centres, and the clusters of each particle. `sums`: quads of
    particles, 0 between substeps."""

    launches = 2  # of `turn`

    def __init__(
        self, clusters: Clusters, arrays: tuple[Arguments, DeviceArray, Arguments], particles: int, parts: frozenset[str],
        real: Real, math: str, stream: Stream,
    ):  # fmt: skip
        self._entries, self._leans, self._gathered = arrays
        particle_order = clusters.of_particle[1]
        self._blocks = max(1, -(-clusters.count // TOGETHER)), THREADS, stream
        self._flat = max(1, -(-particles // THREADS)), THREADS, stream
        zeros: tuple[np.ndarray, ...] = np.zeros(SIZE * particles, real), np.zeros(QUADS * SIZE * clusters.count, real)
        self.sums, self._spins, self._weights = (
            cuda.to_device(array, stream=stream) for array in (*zeros, clusters.weights[particle_order].astype(real))
        )
        self._kernels = make_couples(real, math, "rigid-motion" in parts)

    def turn(self, position: DeviceArray, travel: DeviceArray) -> None:
        """Turn particles after the substep's contacts are projected; `travel`: of rigid bodies, or None."""
        self._kernels.gather[self._blocks](position, self.sums, *self._entries, self._leans, self._spins)
        arguments = position, self.sums, *self._gathered, self._weights, self._spins
        self._kernels.turn[self._flat](*arguments, *(() if travel is None else (travel,)))
