"""CUDA kernels of the moments of friction between particles (model/formulas/shape_matching/couple.py): LANES threads
sum those of a cluster, one computes its rotation, one thread per particle rotates with its clusters."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.shape_matching.kernels import LANES_32, ONE, PITCH, PITCH_32, THREADS, TOGETHER, lane_sum
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, inlined_routine, real, routine
from softlab.model.formulas.shape_matching.couple import SUMS, spin
from softlab.model.formulas.shape_matching.pace import added, weighted
from softlab.model.formulas.shape_matching.rigid import carried
from softlab.model.shape_matching import motions

SHARED = TOGETHER * SUMS * PITCH  # numbers per block
SUMS_32 = np.int32(SUMS)
QUADS = 2  # per cluster: its centre, its turn


@routine
def gather(position, couples, starts, firsts, indices, members, leans, spins):
    """Write the turns of all clusters; in blocks of THREADS."""
    shared = cuda.shared.array(SHARED, real)
    lane, place = np.int32(cuda.threadIdx.x % LANES_32), np.int32(cuda.threadIdx.x // LANES_32)
    c = np.int32(cuda.blockIdx.x * TOGETHER + place)
    clusters = np.int32(firsts.size)
    x, y, z, u, v, w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if c < clusters:
        f = load_quad(position, firsts[c])
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            p, q, m = load_quad(position, indices[e]), load_quad(couples, indices[e]), load_quad(members, e)
            dx, dy, dz = p[0] - f[0], p[1] - f[1], p[2] - f[2]
            wx, wy, wz = weighted(m[3], p[0], f[0]), weighted(m[3], p[1], f[1]), weighted(m[3], p[2], f[2])
            x, y, z = x + wx, y + wy, z + wz
            u, v, w = added(u, m[3], q[0]), added(v, m[3], q[1]), added(w, m[3], q[2])
            xx, yy, zz = added(xx, wx, dx), added(yy, wy, dy), added(zz, wz, dz)
            xy, xz, yz = added(xy, wx, dy), added(xz, wx, dz), added(yz, wy, dz)
    base = np.int32(place * SUMS_32 * PITCH_32)
    at = np.int32(base + lane)
    shared[at], shared[at + PITCH_32], shared[at + 2 * PITCH_32] = x, y, z
    shared[at + 3 * PITCH_32], shared[at + 4 * PITCH_32], shared[at + 5 * PITCH_32] = u, v, w
    shared[at + 6 * PITCH_32], shared[at + 7 * PITCH_32], shared[at + 8 * PITCH_32] = xx, yy, zz
    shared[at + 9 * PITCH_32], shared[at + 10 * PITCH_32], shared[at + 11 * PITCH_32] = xy, xz, yz
    cuda.syncthreads()
    if lane < SUMS_32:
        k = np.int32(base + lane * PITCH_32)
        shared[k] = lane_sum(shared, k)
    cuda.syncthreads()
    if c < clusters and lane == 0:
        f, rest_offset, row = load_quad(position, firsts[c]), load_quad(leans, c), np.int32(QUADS * c)
        cx, cy, cz, ox, oy, oz = spin(
            (shared[base], shared[base + PITCH_32], shared[base + 2 * PITCH_32]),
            (shared[base + 3 * PITCH_32], shared[base + 4 * PITCH_32], shared[base + 5 * PITCH_32]),
            (shared[base + 6 * PITCH_32], shared[base + 7 * PITCH_32], shared[base + 8 * PITCH_32],
             shared[base + 9 * PITCH_32], shared[base + 10 * PITCH_32], shared[base + 11 * PITCH_32]),
            rest_offset[3], (f[0], f[1], f[2]),
        )  # fmt: skip
        store_quad(spins, row, cx, cy, cz, 0.0)
        store_quad(spins, row + 1, ox, oy, oz, 0.0)


@inlined_routine
def spin_of(spins, c):
    row = np.int32(QUADS * c)
    o, t = load_quad(spins, row), load_quad(spins, row + 1)
    return o[0], o[1], o[2], t[0], t[1], t[2]


rotated = filled(motions.rotated, {"spin_of": spin_of})


@inlined_routine
def turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins):
    """Return (old position, new position) of particle k."""
    store_quad(couples, k, 0.0, 0.0, 0.0, 0.0)
    p, first, last = load_quad(position, k), particle_starts[k], particle_starts[k + ONE]
    x, y, z = rotated(p, p[3] != 0.0, first, last, particle_clusters, particle_weights, spins)
    store_quad(position, k, x, y, z, p[3])
    return p, (x, y, z)


@routine
def turn_soft(position, couples, particle_starts, particle_clusters, particle_weights, spins):
    """Turn particles with their clusters and set their couples to 0."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins)


@routine
def turn_rigid(position, couples, particle_starts, particle_clusters, particle_weights, spins, travel):
    """Do the same, and carry the travels of rigid bodies."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, q = turn_one(k, position, couples, particle_starts, particle_clusters, particle_weights, spins)
        t = load_quad(travel, k)
        store_quad(travel, k, carried(t[0], q[0], p[0]), carried(t[1], q[1], p[1]), carried(t[2], q[2], p[2]), t[3])


@cache
def make_couples(real: Real, math: str, has_rigid: bool) -> SimpleNamespace:
    """Compile `gather(position, couples, starts, firsts, indices, members, leans, spins)` and `turn(position, couples,
    particle_starts, particle_clusters, particle_weights, spins)`; with rigid bodies, `has_rigid`, its last argument is
    their `travel`."""
    turn, label = (
        turn_rigid if has_rigid else turn_soft,
        f"bodies_couples_{variant_name(real, math, 'rigid' * has_rigid)}",
    )
    kernels = vars(kernels_of(device_variant(real, math), math, (gather, turn), label))
    return SimpleNamespace(gather=kernels["gather"], turn=kernels[turn.__name__])


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
