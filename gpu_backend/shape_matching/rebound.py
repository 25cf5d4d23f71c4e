"""CUDA kernels of rigid bodies that rebound from colliders as a whole: one thread per particle stores its impulse,
LANES threads sum a cluster's response, one thread per particle applies it (model/shape_matching/rigid_rebound.py).
model/formulas/shape_matching/cluster.py has the order of sums."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide
from softlab.gpu_backend.core.compile import Kernel, kernel_options, kernels_of, make_kernel, variant_name
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.shape_matching.bodies_bounce import make_bodies_bounce, make_give
from softlab.gpu_backend.shape_matching.damping import make_gather
from softlab.gpu_backend.shape_matching.kernels import (
    LANES_32,
    ONE,
    PITCH,
    PITCH_32,
    THREADS,
    TOGETHER,
    lane_sum,
    motion_of,
)
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, real, routine
from softlab.model.formulas.shape_matching.rebound import (
    SUMS,
    bound,
    enlarged,
    rebounded,
    scaled,
    touched,
    weighed,
)
from softlab.model.formulas.shape_matching.rebound import asked as asked_of
from softlab.model.shape_matching.motions import velocity_at
from softlab.model.shape_matching.rigid_rebound import rebound_limits

SHARED = TOGETHER * SUMS * PITCH  # numbers per block
SUMS_32 = np.int32(SUMS)


@routine
def weigh(position, impulses, starts, indices, members, leans, limits, motions):
    """Write the resulting motions of clusters from the impulses on their particles; in blocks of THREADS.

    `limits` (clusters,): 0 of those that do not rebound as a whole.
    """
    shared = cuda.shared.array(SHARED, real)
    lane, place = np.int32(cuda.threadIdx.x % LANES_32), np.int32(cuda.threadIdx.x // LANES_32)
    c = np.int32(cuda.blockIdx.x * TOGETHER + place)
    clusters = np.int32(limits.size)
    got, worth, mass, asked, row = 0.0, 0.0, 0.0, 0.0, np.int32(ROWS * c)
    if c < clusters:
        motion = motion_of(motions, c)
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            p, q, m = load_quad(position, indices[e]), load_quad(impulses, indices[e]), load_quad(members, e)
            u, v, w = velocity_at(motion, p[0], p[1], p[2])
            got = weighed(got, m[3], q[0], q[1], q[2])
            worth = weighed(worth, m[3], u, v, w)
            mass = touched(mass, m[3], q[0], q[1], q[2])
            asked = asked_of(asked, m[3], q[3], q[0], q[1], q[2])
    base = np.int32(place * SUMS_32 * PITCH_32)
    at = np.int32(base + lane)
    shared[at], shared[at + PITCH_32], shared[at + 2 * PITCH_32], shared[at + 3 * PITCH_32] = got, worth, mass, asked
    cuda.syncthreads()
    if lane < SUMS_32:
        k = np.int32(base + lane * PITCH_32)
        shared[k] = lane_sum(shared, k)
    cuda.syncthreads()
    if c < clusters and lane == 0:
        got, worth = shared[base], shared[base + PITCH_32]
        mass, asked = shared[base + 2 * PITCH_32], shared[base + 3 * PITCH_32]
        by = enlarged(got, worth, limits[c])
        t, s = load_quad(motions, row + 1), load_quad(motions, row + 2)
        o = load_quad(motions, row)
        if FEATURE.pairs:
            o = bound(got, mass, asked, load_quad(leans, c)[3]), asked, worth, 0.0
        store_quad(motions, row, o[0], o[1], o[2], 0.0)
        store_quad(motions, row + 1, scaled(t[0], by), scaled(t[1], by), scaled(t[2], by), 0.0)
        store_quad(motions, row + 2, scaled(s[0], by), scaled(s[1], by), scaled(s[2], by), 0.0)


@routine
def go(position, velocity, impulses, particle_starts, particle_clusters, limits, motions):
    """Move the particles of clusters with their resulting motions."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v, q = load_quad(position, k), load_quad(velocity, k), load_quad(impulses, k)
        for n in range(particle_starts[k], particle_starts[k + ONE]):
            if limits[particle_clusters[n]] != 0.0:
                x, y, z = velocity_at(motion_of(motions, particle_clusters[n]), p[0], p[1], p[2])
                x, y, z = rebounded(v[0], q[0], x), rebounded(v[1], q[1], y), rebounded(v[2], q[2], z)
                store_quad(velocity, k, x, y, z, 0.0)


@routine
def differ(velocity, impulses):
    """Write `impulses` from velocities after and, in it, before colliders."""
    k = np.int32(cuda.grid(1))
    if k < velocity.size // SIZE:
        v, u = load_quad(velocity, k), load_quad(impulses, k)
        store_quad(impulses, k, v[0] - u[0], v[1] - u[1], v[2] - u[2], 0.0)


@routine
def store_impulses(before, position, velocity, impulses, record, bodies, integers, counter, place, substeps, substep):
    """Apply colliders, and write their impulses into `impulses`."""
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
        px, py, pz, vx, vy, vz = collide(b, p, v[0], v[1], v[2], world, number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)
        store_quad(impulses, k, vx - v[0], vy - v[1], vz - v[2], 0.0)


@cache
def make_rebound(real: Real, math: str, has_contacts: bool = False) -> SimpleNamespace:
    """Compile `weigh(position, impulses, starts, indices, members, leans, limits, motions)`, `go(position, velocity,
    impulses, particle_starts, particle_clusters, limits, motions)` and `differ(velocity, impulses)`. `has_contacts`: with
    the bound for bodies in contact."""
    label = f"bodies_rebound_{variant_name(real, math, 'meets' * has_contacts)}"
    return kernels_of(device_variant(real, math, {"pairs": has_contacts}), math, (weigh, go, differ), label)


@cache
def make_collide_rebound(real: Real, math: str, parts: frozenset[str]) -> Kernel:
    """Compile store_impulses(before, position, velocity, impulses, record, bodies, integers, counter, place, substeps,
    substep)."""
    kernel = device_variant(real, math, particle_features(parts)).copied(store_impulses)
    return make_kernel(kernel, f"bodies_rebound_{variant_name(real, math, parts)}", **kernel_options(math))


class Rebounds:
    """Rebounds of the bodies of `clusters`, if a scene has any that rebound as a whole.

    `own` (entries,): entries in the particles' order. `struck`: a quad per particle, its velocity before colliders,
    then their impulse. `contacts`: those of the scene, if they have restitution for rigid bodies; `turns`: true if
    colliders do.
    """

    launches = 4  # `strike`, and the following ones
    restitution_launches = 8  # of `bounce`
    contacts: Any

    def __init__(
        self, clusters: Clusters, particle_order: np.ndarray, particles: int, contacts: Any, parts: frozenset[str],
        real: Real, math: str, stream: Stream,
    ):  # fmt: skip
        self.turns, self.contacts = "rigid-rebound" in parts, contacts if "rigid-bounce" in parts else None
        self._clusters, self._stream, self._flat = clusters, stream, (max(1, -(-particles // THREADS)), THREADS, stream)
        self._kernels, self._gather = make_rebound(real, math), make_gather(real, math)
        self.store_impulses, self._meeting = make_collide_rebound(real, math, parts), make_rebound(real, math, True)
        if self.contacts:
            self._bounce = make_bodies_bounce(real, math)
            self._gives = [make_give(real, math, *contacts.variant, scaled) for scaled in (False, True)]
            self._scales = cuda.to_device(np.zeros(SIZE * particles, real), stream=stream)
        limits: np.ndarray = rebound_limits(clusters).astype(real)
        zeros: tuple[np.ndarray, ...] = np.zeros(SIZE * particles, real), np.zeros(ROWS * SIZE * clusters.count, real)
        self._limits, self.impulses, self._motions = (
            cuda.to_device(array, stream=stream) for array in (limits, *zeros)
        )

    def differ(self, velocity: DeviceArray) -> None:
        """Compute the impulses of colliders, from the velocities before them in `struck`."""
        self._kernels.differ[self._flat](velocity, self.impulses)

    def run(
        self, position: DeviceArray, velocity: DeviceArray, entries: Arguments, leans: DeviceArray, gathered: Arguments
    ) -> None:
        """Update the velocities by the clusters' responses; other arrays as of the solver's other kernels."""
        blocks = max(1, -(-self._clusters.count // TOGETHER)), THREADS, self._stream
        self._weigh(self._kernels, blocks, position, entries, leans)
        self._kernels.go[self._flat](position, velocity, self.impulses, *gathered[:2], self._limits, self._motions)

    def bounce(
        self, position: DeviceArray, old: DeviceArray, velocity: DeviceArray, travel: DeviceArray, entries: Arguments,
        leans: DeviceArray, gathered: Arguments,
    ) -> None:  # fmt: skip
        """Update the velocities after particles bounced off each other, of bodies as wholes, whose velocities are rigid
        motions.

        Impulses are scaled for each pair by the smaller one of the factors of both bodies.
        """
        blocks, flat = (max(1, -(-self._clusters.count // TOGETHER)), THREADS, self._stream), self._flat
        of_particle, motions = gathered[:2], self._motions
        arguments = *self.contacts.count_impacts(position, old, velocity, travel), self._scales, self.impulses
        plain, scaled = self._gives
        plain[flat](*arguments)
        self._weigh(self._meeting, blocks, position, entries, leans)
        self._bounce.spread[flat](*of_particle, self._limits, motions, self._scales)
        scaled[flat](*arguments)
        self._gather[blocks](position, self.impulses, *entries, leans, motions)
        self._bounce.join[flat](position, velocity, self.impulses, *of_particle, self._limits, motions)

    def _weigh(self, kernels: Any, blocks: Any, position: DeviceArray, entries: Arguments, leans: DeviceArray) -> None:
        """Compute the clusters' motions from the impulses on their particles."""
        starts, _, indices, members = entries
        self._gather[blocks](position, self.impulses, *entries, leans, self._motions)
        kernels.weigh[blocks](position, self.impulses, starts, indices, members, leans, self._limits, self._motions)
