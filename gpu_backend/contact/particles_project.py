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
from softlab.gpu_backend.core.compile import kernel_options, kernels_of, make_kernels, variant_name
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine
from softlab.model.contact.particle_parameters import (
    G_ACTIVE,
    G_DISTANCE,
    G_PULL,
    G_SELF_DISTANCE,
    H_ASLEEP,
    H_DYNAMIC,
    H_FASTEST,
    H_PUSH,
    H_STATIC,
)
from softlab.model.formulas.particle_contact import (
    added,
    added_friction,
    direction,
    enforced_distance,
    far,
    grip,
    moved,
    rested,
    shortened,
    slip,
    split,
    squared,
    within,
)
from softlab.model.formulas.particle_contact import depth as depth_of
from softlab.model.formulas.particle_contact import pressed as pressed_by
from softlab.model.formulas.shape_matching.couple import gathered, levered
from softlab.model.formulas.shape_matching.rigid import carried


@inlined_routine
def lever(couple, fraction, length, d, b, depth, pull, n, record):
    """Return the sum of a particle's couple and the contribution of a contact."""
    (u, v, w), (nx, ny, nz) = couple, n
    if depth > 0.0 or pull > 0.0:
        sx, sy, sz = slip(d[0], d[1], d[2], b[0], b[1], b[2], nx, ny, nz)
        gripped = grip(sx, sy, sz, depth, pull, record[H_STATIC], record[H_DYNAMIC])
        u = levered(u, fraction, length, gripped, ny, sz, nz, sy)
        v = levered(v, fraction, length, gripped, nz, sx, nx, sz)
        w = levered(w, fraction, length, gripped, nx, sy, ny, sx)
    return u, v, w


@inlined_routine
def displacement_added(displacement, fraction, d, b, depth, pull, n, record):
    """Return the sum of a particle's displacement and that of a contact; d, b: the pair's distance vectors now and
    before; n: the contact's normal."""
    (x, y, z), (nx, ny, nz) = displacement, n
    if FEATURE.contact_friction:
        if depth > 0.0 or pull > 0.0:
            sx, sy, sz = slip(d[0], d[1], d[2], b[0], b[1], b[2], nx, ny, nz)
            gripped = grip(sx, sy, sz, depth, pull, record[H_STATIC], record[H_DYNAMIC])
            x = added_friction(x, fraction, depth, nx, gripped, sx)
            y = added_friction(y, fraction, depth, ny, gripped, sy)
            z = added_friction(z, fraction, depth, nz, gripped, sz)
            return x, y, z
    return added(x, fraction, depth, nx), added(y, fraction, depth, ny), added(z, fraction, depth, nz)


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


@inlined_routine
def project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written):
    """Project the contacts of particle i; `kinds_of`: (body, kind, kinds); `written`: (travel, pressed, couples)."""
    (body, kind, kinds), (travel, pressed, couples) = kinds_of, written
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], CAPACITY)), np.int64(neighbour_counts.size)
        if neighbour_count > 0:
            p = load_quad(touching, i)
            if p[3] > 0.0:
                start, x, y, z = load_quad(before, i), 0.0, 0.0, 0.0
                u, v, w = 0.0, 0.0, 0.0
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
                        length, nx, ny, nz = direction(d[0], d[1], d[2], distance, i < j)
                        enforced = enforced_distance(distance, b[0], b[1], b[2], record[H_PUSH])
                        depth = depth_of(length, enforced, distance, pull)
                        if FEATURE.rigid_motion:
                            k = s * particles + i
                            pressed[k] = pressed_by(pressed[k], fraction, depth)
                        x, y, z = displacement_added((x, y, z), fraction, d, b, depth, pull, (nx, ny, nz), record)
                        if FEATURE.couples:
                            u, v, w = lever((u, v, w), fraction, length, d, b, depth, pull, (nx, ny, nz), record)
                weight = start[3]
                x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
                if FEATURE.rigid_motion:
                    t = load_quad(travel, i)
                    store_quad(travel, i, carried(t[0], x, p[0]), carried(t[1], y, p[1]), carried(t[2], z, p[2]), t[3])
                store_quad(position, i, x, y, z, weight)
                if FEATURE.couples:
                    c = load_quad(couples, i)
                    u, v, w = gathered(c[0], weight, u), gathered(c[1], weight, v), gathered(c[2], weight, w)
                    store_quad(couples, i, u, v, w, 0.0)


@routine
def project_soft(before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching):
    """Move particles, in place."""
    i = np.int32(cuda.grid(1))
    kinds_of, written = (body, kind, kinds), (touching, touching, touching)
    project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written)


@routine
def project_rigid(before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed):
    """Do as `project_soft`, and update the travels (shape_matching/rigid.py) and contact impulses of rigid bodies."""
    i = np.int32(cuda.grid(1))
    kinds_of, written = (body, kind, kinds), (travel, pressed, touching)
    project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written)


@routine
def project_coupled(before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, couples):
    """Do as `project_soft`, and update `couples` (shape_matching/couples.py), by which friction turns clusters."""
    i = np.int32(cuda.grid(1))
    kinds_of, written = (body, kind, kinds), (touching, touching, couples)
    project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written)


@routine
def project_all(
    before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed, couples
):
    """Do as `project_rigid` and `project_coupled`."""
    i = np.int32(cuda.grid(1))
    kinds_of, written = (body, kind, kinds), (travel, pressed, couples)
    project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written)


@routine
def clear(neighbour_counts, pressed):
    """Zero the contact impulses of neighbours, indexed as `neighbours`."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        particles = np.int64(neighbour_counts.size)
        for s in range(np.int32(min(neighbour_counts[i], CAPACITY))):
            pressed[s * particles + i] = 0.0


@inlined_routine
def calmed(b, p, record):
    """Return a particle (a quad) after the speed limit and sleeping; b: at the start of the substep."""
    x, y, z = p[0], p[1], p[2]
    if FEATURE.speed_limit or FEATURE.sleeping:
        length = far(x - b[0], y - b[1], z - b[2])
        if FEATURE.speed_limit:
            most = record[H_FASTEST]
            x, y = shortened(x, b[0], length, most), shortened(y, b[1], length, most)
            z = shortened(z, b[2], length, most)
        if FEATURE.sleeping:
            least = record[H_ASLEEP]
            x, y, z = rested(x, b[0], length, least), rested(y, b[1], length, least), rested(z, b[2], length, least)
    return x, y, z, p[3]


@routine
def finish(before, position, velocity, contact_record, record, bodies, integers, counter, place, substeps, substep):
    """Write velocities, after the colliders, at the end of a substep."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p = load_quad(before, k), load_quad(position, k)
        px, py, pz, vx, vy, vz = settle(b, calmed(b, p, contact_record), World(record[0], bodies, integers), number)
        store_quad(position, k, px, py, pz, b[3])
        store_quad(velocity, k, vx, vy, vz, 0.0)


@routine
def update_velocity(before, position, velocity, contact_record, record):
    """Write velocities at the end of a substep, without colliders."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        b = load_quad(before, k)
        p = calmed(b, load_quad(position, k), contact_record)
        vx, vy, vz = rate_of(p, b, record[0])
        store_quad(position, k, p[0], p[1], p[2], b[3])
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
    soft, rigid = (project_coupled, project_all) if has_couples else (project_soft, project_rigid)
    project = variant.copied(rigid if has_rigid else soft)
    project.__name__ = "project"
    words = (
        "friction" * has_friction, "adhesion" * has_adhesion, f"own{self_contact:d}", f"many{many:d}", "rigid" * has_rigid,
        "couples" * has_couples,
    )  # fmt: skip
    kernels = variant.copied(count), project, variant.copied(clear)
    return make_kernels(kernels, f"particle_contacts_{variant_name(real, math, *words)}", **kernel_options(math))


@cache
def make_contact_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the kernels that end a substep: `finish`, `update_velocity` and `collide`."""
    variant, kernels = device_variant(real, math, particle_features(parts)), (finish, update_velocity, collide)
    return kernels_of(variant, math, kernels, f"contact_ends_{variant_name(real, math, parts)}")
