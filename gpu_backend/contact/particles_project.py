"""Projection of particle contacts on CUDA: one thread per particle counts its contacts, then moves it.

All contacts are projected from one state: a particle with neighbours copies its position while it counts, and reads the
copies of others while it moves. So positions stay in their buffer, and a particle without neighbours costs one load.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide as touch
from softlab.gpu_backend.contact.motion import rate_of, settle
from softlab.gpu_backend.contact.particles_find import CAPACITY, pair_of
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, real, routine
from softlab.model.contact.particle_contacts import calmed, contact_added
from softlab.model.contact.particle_parameters import (
    G_ACTIVE,
    G_DISTANCE,
    G_PULL,
    G_SELF_DISTANCE,
)
from softlab.model.formulas.particle_contact import moved, split, squared, within
from softlab.model.formulas.particle_contact import pressed as pressed_by
from softlab.model.formulas.shape_matching.couple import gathered
from softlab.model.formulas.shape_matching.rigid import carried


@routine
def count(position, neighbour_counts, neighbours, record, body, kind, kinds, touching):
    """Write for each particle with neighbours a quad of its position and of its weight times its contacts."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], CAPACITY)), np.int64(neighbour_counts.size)
        if neighbour_count > 0:
            p, contacts = load_quad(position, i), np.int32(0)
            for s in range(neighbour_count):
                j = neighbours[s * particles + i]
                q, (row, same) = load_quad(position, j), pair_of(i, j, body, kind, kinds)
                active = record[row + G_SELF_DISTANCE] if same else record[row + G_ACTIVE]
                if within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), active):
                    contacts = np.int32(contacts + 1)
            store_quad(touching, i, p[0], p[1], p[2], p[3] * real(contacts))


@routine
def project(
    before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed, couples
):
    """Move particles, in place. Update the travels (shape_matching/rigid.py) and contact impulses of rigid bodies, and
    `couples` (shape_matching/couples.py), by which friction turns clusters, if there are any."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], CAPACITY)), np.int64(neighbour_counts.size)
        if neighbour_count > 0:
            p = load_quad(touching, i)
            if p[3] > 0.0:
                start, sums, couple = load_quad(before, i), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
                for s in range(neighbour_count):
                    j = neighbours[s * particles + i]
                    q, (row, same) = load_quad(touching, j), pair_of(i, j, body, kind, kinds)
                    d = p[0] - q[0], p[1] - q[1], p[2] - q[2]
                    active = record[row + G_SELF_DISTANCE] if same else record[row + G_ACTIVE]
                    if within(squared(d[0], d[1], d[2]), active):
                        distance = record[row + G_SELF_DISTANCE] if same else record[row + G_DISTANCE]
                        pull = 0.0
                        if FEATURE.contact_adhesion:
                            if not same:
                                pull = record[row + G_PULL]
                        other = load_quad(before, j)
                        b = start[0] - other[0], start[1] - other[1], start[2] - other[2]
                        fraction = split(p[3], 1.0, q[3], 1.0)
                        sums, couple, depth = contact_added(
                            (sums, couple), d, b, i < j, distance, pull, fraction, record
                        )
                        if FEATURE.rigid_motion:
                            k = s * particles + i
                            pressed[k] = pressed_by(pressed[k], fraction, depth)
                weight = start[3]
                x, y, z = moved(p[0], weight, sums[0]), moved(p[1], weight, sums[1]), moved(p[2], weight, sums[2])
                if FEATURE.rigid_motion:
                    t = load_quad(travel, i)
                    store_quad(travel, i, carried(t[0], x, p[0]), carried(t[1], y, p[1]), carried(t[2], z, p[2]), t[3])
                store_quad(position, i, x, y, z, weight)
                if FEATURE.couples:
                    c = load_quad(couples, i)
                    u, v = gathered(c[0], weight, couple[0]), gathered(c[1], weight, couple[1])
                    w = gathered(c[2], weight, couple[2])
                    store_quad(couples, i, u, v, w, 0.0)


@routine
def clear(neighbour_counts, pressed):
    """Zero the contact impulses of neighbours, indexed as `neighbours`."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        particles = np.int64(neighbour_counts.size)
        for s in range(np.int32(min(neighbour_counts[i], CAPACITY))):
            pressed[s * particles + i] = 0.0


@routine
def finish(before, position, velocity, contact_record, record, bodies, integers, counter, place, substeps, substep):
    """Write velocities, after the colliders, at the end of a substep."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p = load_quad(before, k), load_quad(position, k)
        x, y, z = calmed(b, p, contact_record)
        px, py, pz, vx, vy, vz = settle(b, (x, y, z, p[3]), World(record[0], bodies, integers), number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def update_velocity(before, position, velocity, contact_record, record):
    """Write velocities at the end of a substep, without colliders."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b, p = load_quad(before, k), load_quad(position, k)
        x, y, z = calmed(b, p, contact_record)
        vx, vy, vz = rate_of((x, y, z, p[3]), b, record[0])
        store_quad(position, k, x, y, z, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def collide(before, position, velocity, record, bodies, integers, counter, place, substeps, substep):
    """Apply the colliders at the end of a substep."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
        px, py, pz, vx, vy, vz = touch(b, p, v[0], v[1], v[2], World(record[0], bodies, integers), number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@cache
def make_project(
    real: Real, math: str, has_friction: bool, has_adhesion: bool, self_contact: bool, many: bool,
    has_rigid: bool = False, has_couples: bool = False,
) -> SimpleNamespace:  # fmt: skip
    """Compile `count`, `project` and `clear`. `self_contact`, `many`: of particles_find.py."""
    features = {
        "contact_friction": has_friction, "contact_adhesion": has_adhesion, "self_contact": self_contact, "kinds": many,
        "rigid_motion": has_rigid, "couples": has_couples,
    }  # fmt: skip
    variant = device_variant(real, math, features)
    words = (
        "friction" * has_friction, "adhesion" * has_adhesion, f"own{self_contact:d}", f"many{many:d}", "rigid" * has_rigid,
        "couples" * has_couples,
    )  # fmt: skip
    return kernels_of(variant, math, (count, project, clear), f"particle_contacts_{variant_name(real, math, *words)}")


@cache
def make_contact_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the kernels that end a substep: `finish`, `update_velocity` and `collide`."""
    variant, kernels = device_variant(real, math, particle_features(parts)), (finish, update_velocity, collide)
    return kernels_of(variant, math, kernels, f"contact_ends_{variant_name(real, math, parts)}")
