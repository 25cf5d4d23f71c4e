"""CUDA kernels of rigid bodies that rebound from colliders as a whole: one thread per particle stores its impulse,
LANES threads sum a cluster's response, one thread per particle applies it (model/shape_matching/rigid_rebound.py).
model/formulas/shape_matching/cluster.py has the order of sums."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import AXES, ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.shape_matching.bodies_bounce import make_bodies_bounce, make_give
from softlab.gpu_backend.shape_matching.damping import make_gather
from softlab.gpu_backend.shape_matching.kernels import PITCH, THREADS, TOGETHER, make_lane_sum
from softlab.model.assets.clusters import Clusters
from softlab.model.base.types import Real
from softlab.model.formulas.shape_matching import rebound
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.rebound import SUMS
from softlab.model.shape_matching.rigid_rebound import rebound_limits

SHARED = TOGETHER * SUMS * PITCH  # numbers per block


@cache
def make_rebound(real: Real, math: str, has_contacts: bool = False) -> SimpleNamespace:
    """Compile `weigh`, `go` and `differ`.

    `weigh(position, impulses, starts, indices, members, leans, limits, motions)`: the resulting motions of clusters, in
    blocks of THREADS, from the impulses on their particles, `impulses`; `go(position, velocity, impulses,
    particle_starts, particle_clusters, limits, motions)`: particles; `differ(velocity, impulses)`: `impulses` from
    velocities after and, in it, before colliders. `limits` (clusters,): 0 of those that do not rebound as a whole.
    `has_contacts`: with the bound for bodies in contact.
    """
    formulas, lane_sum = device_formulas(rebound, real, math), make_lane_sum(real, math)
    weighed, rigid, enlarged = formulas.weighed, formulas.rigid, formulas.enlarged
    scaled, rebounded, touched, wanted, bound = (
        formulas.scaled, formulas.rebounded, formulas.touched, formulas.asked, formulas.bound
    )  # fmt: skip
    zero, one, lanes, pitch, sums = real(0), np.int32(1), np.int32(LANES), np.int32(PITCH), np.int32(SUMS)

    def weigh(position, impulses, starts, indices, members, leans, limits, motions):
        shared = cuda.shared.array(SHARED, real)
        lane, place = np.int32(cuda.threadIdx.x % lanes), np.int32(cuda.threadIdx.x // lanes)
        c = np.int32(cuda.blockIdx.x * TOGETHER + place)
        clusters = np.int32(limits.size)
        got, worth, mass, asked, row = zero, zero, zero, zero, np.int32(ROWS * c)
        if c < clusters:
            o, t, s = load_quad(motions, row), load_quad(motions, row + 1), load_quad(motions, row + 2)
            for e in range(np.int32(starts[c] + lane), starts[c + one], lanes):
                p, q, m = load_quad(position, indices[e]), load_quad(impulses, indices[e]), load_quad(members, e)
                dx, dy, dz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
                u = rigid(t[0], s[1], dz, s[2], dy)
                v = rigid(t[1], s[2], dx, s[0], dz)
                w = rigid(t[2], s[0], dy, s[1], dx)
                got = weighed(got, m[3], q[0], q[1], q[2])
                worth = weighed(worth, m[3], u, v, w)
                mass = touched(mass, m[3], q[0], q[1], q[2])
                asked = wanted(asked, m[3], q[3], q[0], q[1], q[2])
        base = np.int32(place * sums * pitch)
        at = np.int32(base + lane)
        shared[at], shared[at + pitch], shared[at + 2 * pitch], shared[at + 3 * pitch] = got, worth, mass, asked
        cuda.syncthreads()
        if lane < sums:
            k = np.int32(base + lane * pitch)
            shared[k] = lane_sum(shared, k)
        cuda.syncthreads()
        if c < clusters and lane == 0:
            got, worth, mass, asked = (
                shared[base],
                shared[base + pitch],
                shared[base + 2 * pitch],
                shared[base + 3 * pitch],
            )
            by = enlarged(got, worth, limits[c])
            t, s = load_quad(motions, row + 1), load_quad(motions, row + 2)
            o = load_quad(motions, row)
            if has_contacts:
                o = bound(got, mass, asked, load_quad(leans, c)[3]), asked, worth, zero
            store_quad(motions, row, o[0], o[1], o[2], zero)
            store_quad(motions, row + 1, scaled(t[0], by), scaled(t[1], by), scaled(t[2], by), zero)
            store_quad(motions, row + 2, scaled(s[0], by), scaled(s[1], by), scaled(s[2], by), zero)

    def go(position, velocity, impulses, particle_starts, particle_clusters, limits, motions):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v, q = load_quad(position, k), load_quad(velocity, k), load_quad(impulses, k)
            for n in range(particle_starts[k], particle_starts[k + one]):
                if limits[particle_clusters[n]] != zero:
                    row = np.int32(ROWS * particle_clusters[n])
                    o, t, s = load_quad(motions, row), load_quad(motions, row + 1), load_quad(motions, row + 2)
                    dx, dy, dz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
                    store_quad(
                        velocity, k, rebounded(v[0], q[0], rigid(t[0], s[1], dz, s[2], dy)),
                        rebounded(v[1], q[1], rigid(t[1], s[2], dx, s[0], dz)),
                        rebounded(v[2], q[2], rigid(t[2], s[0], dy, s[1], dx)), zero,
                    )  # fmt: skip

    def differ(velocity, impulses):
        k = np.int32(cuda.grid(1))
        if k < velocity.size // SIZE:
            v, u = load_quad(velocity, k), load_quad(impulses, k)
            store_quad(impulses, k, v[0] - u[0], v[1] - u[1], v[2] - u[2], zero)

    name = f"bodies_rebound_{variant_name(real, math, 'meets' * has_contacts)}"
    return make_kernels((weigh, go, differ), name, **kernel_options(math))


@cache
def make_collide_rebound(real: Real, math: str, parts: frozenset[str]) -> Kernel:
    """Compile store_impulses(before, position, velocity, impulses, record, bodies, integers, counter, place, substeps,
    substep): colliders, with their impulses written into `impulses`."""
    collide, clock, zero = make_motion(real, math, parts, AXES).collide, make_clock(math, parts), real(0)

    def store_impulses(
        before, position, velocity, impulses, record, bodies, integers, counter, place, substeps, substep
    ):
        world = World(record[0], bodies, integers)
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            _, number = clock(counter, place, substeps, substep)
            b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
            px, py, pz, vx, vy, vz = collide(b, p, v[0], v[1], v[2], world, number)
            store_quad(position, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)
            store_quad(impulses, k, vx - v[0], vy - v[1], vz - v[2], zero)

    return make_kernel(store_impulses, f"bodies_rebound_{variant_name(real, math, parts)}", **kernel_options(math))


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
