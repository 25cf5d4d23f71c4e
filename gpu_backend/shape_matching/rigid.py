"""CUDA kernels of rigid bodies that conserve their momenta up to rounding (model/formulas/shape_matching/rigid.py), one
thread per particle: they replace those of kernels.py and damping.py if a scene has such bodies.

A particle's travel is a quad with its slack, 0 for particles of no rigid body.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import kick, rate_of
from softlab.gpu_backend.contact.motion import predict as predict_position
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.forces import add_gravity, add_particle_force, particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import AXES, ROWS, SIZE, load_quad, pack, store_quad
from softlab.gpu_backend.shape_matching.damping import make_gather
from softlab.gpu_backend.shape_matching.kernels import (
    LANES_32,
    NO_STEP,
    ONE,
    THREADS,
    TOGETHER,
    displacement_to_goals,
    motion_of,
)
from softlab.model.assets.clusters import Clusters, whole_clusters
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.contact.particle_contacts import calmed
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.rigid import carried, rate_over, settled, travelled
from softlab.model.shape_matching.motions import velocity_at
from softlab.model.shape_matching.rigid_motion import goal_slack


@inlined_routine
def store_prediction(k, p, v, ax, ay, az, predicted, parameters, travel):
    """Write the prediction of particle `k` and its travel."""
    x, y, z = predict_position(p, v, ax, ay, az, parameters)
    store_quad(predicted, k, x, y, z, p[3])
    h, (u, v, w) = parameters.dt, kick(p, v, ax, ay, az, parameters)
    store_quad(travel, k, travelled(h, u), travelled(h, v), travelled(h, w), load_quad(travel, k)[3])


@routine
def begin(position, velocity, predicted, record, integers, travel):
    """Predict the particles, and their travels."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = add_gravity(0.0, 0.0, 0.0, parameters)
        ax, ay, az = add_particle_force(ax, ay, az, k, p[3], parameters, integers, NO_STEP)
        store_prediction(k, p, v, ax, ay, az, predicted, parameters, travel)


@routine
def predict(before, velocity, a, position, record, travel):
    """Do the same from accelerations `a`, which are then set to 0."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b = load_quad(a, k)
        store_prediction(k, load_quad(before, k), load_quad(velocity, k), b[0], b[1], b[2], position, record[0], travel)
        store_quad(a, k, 0.0, 0.0, 0.0, 0.0)


@inlined_routine
def settled_position(p, k, particle_starts, particle_clusters, particle_members, frames, t):
    """Return the position of particle `k` at `p`, moved towards its goals; `t`: its travel and slack."""
    first, last = particle_starts[k], particle_starts[k + ONE]
    x, y, z = displacement_to_goals(p, first, last, particle_clusters, particle_members, frames)
    return p[0] + settled(x, t[3], p[0]), p[1] + settled(y, t[3], p[1]), p[2] + settled(z, t[3], p[2])


@inlined_routine
def store_state(k, b, p, position, velocity, parameters, travel):
    """Write the position p and velocity of particle `k`, of a rigid body from its travel (three numbers, slack)."""
    inverse, (u, v, w, slack) = parameters.inverse_substep, travel
    vx, vy, vz = rate_of((p[0], p[1], p[2], b[3]), b, parameters)
    if slack > 0.0:
        vx, vy, vz = rate_over(u, inverse), rate_over(v, inverse), rate_over(w, inverse)
        if FEATURE.pins:
            if b[3] == 0.0:
                vx, vy, vz = 0.0, 0.0, 0.0
    store_quad(position, k, p[0], p[1], p[2], b[3])
    store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def move(position, particle_starts, particle_clusters, particle_members, frames, travel):
    """Move the particles towards their goals, in place."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        x, y, z = settled_position(
            p, k, particle_starts, particle_clusters, particle_members, frames, load_quad(travel, k)
        )
        store_quad(position, k, x, y, z, p[3])


@routine
def rate(before, position, velocity, particle_starts, particle_clusters, particle_members, frames, record, travel):
    """Move the particles towards their goals, and write their velocities."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p, t = load_quad(before, k), load_quad(position, k), load_quad(travel, k)
        q = settled_position(p, k, particle_starts, particle_clusters, particle_members, frames, t)
        store_state(k, b, q, position, velocity, record[0], t)


@routine
def update(before, position, velocity, record, travel):
    """Write only velocities, for rigid bodies from their travels."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p, t = load_quad(before, k), load_quad(position, k), load_quad(travel, k)
        store_state(k, b, p, position, velocity, record[0], t)


@routine
def update_calmed(before, position, velocity, contact_record, record, travel):
    """Do the same with speed limit and sleeping."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p, t = load_quad(before, k), load_quad(position, k), load_quad(travel, k)
        x, y, z = calmed(b, p, contact_record)
        u, v, w = t[0], t[1], t[2]
        if FEATURE.speed_limit or FEATURE.sleeping:
            u, v, w = carried(u, x, p[0]), carried(v, y, p[1]), carried(w, z, p[2])
        store_state(k, b, (x, y, z), position, velocity, record[0], (u, v, w, t[3]))


@routine
def steady(position, velocity, particle_starts, particle_clusters, factors, motions):
    """Write velocities from the bodies' motions."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p = load_quad(position, k)
        for n in range(particle_starts[k], particle_starts[k + ONE]):
            if factors[n] != 0.0:
                x, y, z = velocity_at(motion_of(motions, particle_clusters[n]), p[0], p[1], p[2])
                store_quad(velocity, k, x, y, z, 0.0)


@routine
def rest(before, position, velocity, starts, indices, whole):
    """Stop each `whole` cluster (clusters,) none of whose particles has moved; in blocks of THREADS."""
    shared = cuda.shared.array(THREADS, np.int32)
    thread = np.int32(cuda.threadIdx.x)
    lane, c = np.int32(thread % LANES_32), np.int32(cuda.blockIdx.x * TOGETHER + thread // LANES_32)
    has_moved, stops = np.int32(0), False
    if c < whole.size:
        stops = whole[c] != 0
    if stops:
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            b, p = load_quad(before, indices[e]), load_quad(position, indices[e])
            if p[0] != b[0] or p[1] != b[1] or p[2] != b[2]:
                has_moved = ONE
    shared[thread] = has_moved
    cuda.syncthreads()
    for n in range(LANES):
        has_moved = np.int32(has_moved | shared[thread - lane + n])
    if stops and has_moved == 0:
        for e in range(np.int32(starts[c] + lane), starts[c + ONE], LANES_32):
            store_quad(velocity, indices[e], 0.0, 0.0, 0.0, 0.0)


@cache
def make_begin(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `begin(position, velocity, predicted, record, integers, travel)` and `predict(before, velocity, a, position,
    record, travel)`."""
    variant, kernels = device_variant(real, math, particle_features(parts)), (with_forces(begin, parts), predict)
    return kernels_of(variant, math, kernels, f"bodies_rigid_{variant_name(real, math, parts)}")


@cache
def make_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `move`, `rate`, `update`, `update_calmed`, `rest` and `steady`."""
    variant, kernels = (
        device_variant(real, math, particle_features(parts)),
        (move, rate, update, update_calmed, rest, steady),
    )
    return kernels_of(variant, math, kernels, f"bodies_rigid_{variant_name(real, math, parts)}")


class RigidMotion:
    """Motion of the rigid ones of `clusters`; `particle_order` (entries,): entries in the particles' order. `travel`:
    quads of particles."""

    def __init__(
        self, clusters: Clusters, particle_order: np.ndarray, particles: int, parts: frozenset[str], real: Real,
        math: str, stream: Stream
    ):  # fmt: skip
        self._blocks = max(1, -(-clusters.count // TOGETHER)), THREADS, stream
        self._flat = max(1, -(-particles // THREADS)), THREADS, stream
        slack = goal_slack(clusters, real)
        travel: np.ndarray = np.zeros((particles, SIZE), real)
        travel[:, AXES] = slack
        factors = whole_clusters(clusters)[clusters.owner][particle_order].astype(real)
        motions: np.ndarray = np.zeros(ROWS * SIZE * clusters.count, real)
        self.travel, self._factors, self._motions = (
            cuda.to_device(array, stream=stream) for array in (pack(travel), factors, motions)
        )
        self.begins, self.ends = make_begin(real, math, parts), make_ends(real, math, parts)
        self._gather, self._sleeps = make_gather(real, math), "sleeping" in parts
        self._whole = cuda.to_device(whole_clusters(clusters).astype(np.int32), stream=stream)
        self.launches = 2 + self._sleeps  # of `steady` and `rest`

    def rest(self, before: DeviceArray, position: DeviceArray, velocity: DeviceArray, entries: Arguments) -> None:
        """Zero the velocities of bodies that sleep, at the substep's end."""
        if self._sleeps:
            self.ends.rest[self._blocks](before, position, velocity, entries[0], entries[2], self._whole)

    def steady(
        self, position: DeviceArray, velocity: DeviceArray, entries: Arguments, leans: DeviceArray, gathered: Arguments
    ) -> None:
        """Replace velocities by rigid motions of the same momenta."""
        self._gather[self._blocks](position, velocity, *entries, leans, self._motions)
        self.ends.steady[self._flat](position, velocity, *gathered[:2], self._factors, self._motions)
