"""Projection of particle contacts on CUDA: one thread per particle counts its contacts, then moves it.

All contacts are projected from one state: a particle with neighbours copies its position while it counts, and reads the
copies of others while it moves. So positions stay in their buffer, and a particle without neighbours costs one load.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.contact.particles_find import make_pairs
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import AXES, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.model.base.types import Real
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
    MAX_NEIGHBOURS,
)
from softlab.model.formulas import particle_contact
from softlab.model.formulas.shape_matching import couple as formulas_of_couple
from softlab.model.formulas.shape_matching import rigid


@cache
def make_project(
    real: Real,
    math: str,
    has_friction: bool,
    has_adhesion: bool,
    self_contact: bool,
    many: bool,
    has_rigid: bool = False,
    has_couples: bool = False,
) -> SimpleNamespace:
    """Compile `count`, `project` and `clear`.

    `count(position, neighbour_counts, neighbours, record, body, kind, kinds, touching)`: for each particle with
    neighbours a quad of its position and of its weight times its contacts. `project(before, position, neighbour_counts,
    neighbours, record, body, kind, kinds, touching, travel, pressed)`: particles, in place, and with rigid bodies,
    `has_rigid`, their travels (shape_matching/rigid.py) and the contact impulses of neighbours, indexed as
    `neighbours`, which `clear(neighbour_counts, pressed)` has zeroed; with friction that turns clusters, `has_couples`,
    its last argument is the particles' `couples` (shape_matching/couples.py). `has_friction`, `has_adhesion`: code for
    those; `self_contact`, `many`: as in `make_pairs`.
    """
    formulas = device_formulas(particle_contact, real, math)
    squared, within, split, enforced_distance = (
        formulas.squared,
        formulas.within,
        formulas.split,
        formulas.enforced_distance,
    )
    direction, depth_of, slip, grip = formulas.direction, formulas.depth, formulas.slip, formulas.grip
    added, added_friction, moved = formulas.added, formulas.added_friction, formulas.moved
    pair_of, zero, one, most = make_pairs(self_contact, many), real(0), real(1), np.int32(MAX_NEIGHBOURS)
    pressed_by = formulas.pressed
    carried, levers = device_formulas(rigid, real, math).carried, device_formulas(formulas_of_couple, real, math)
    levered, gathered = levers.levered, levers.gathered

    @inlined(math)
    def lever(couple, fraction, length, d, b, depth, pull, n, record):
        """Return the sum of a particle's couple and the contribution of a contact."""
        (u, v, w), (nx, ny, nz) = couple, n
        if depth > zero or pull > zero:
            sx, sy, sz = slip(d[0], d[1], d[2], b[0], b[1], b[2], nx, ny, nz)
            gripped = grip(sx, sy, sz, depth, pull, record[H_STATIC], record[H_DYNAMIC])
            u = levered(u, fraction, length, gripped, ny, sz, nz, sy)
            v = levered(v, fraction, length, gripped, nz, sx, nx, sz)
            w = levered(w, fraction, length, gripped, nx, sy, ny, sx)
        return u, v, w

    @inlined(math)
    def displacement_added(way, fraction, d, b, depth, pull, n, record):
        """Return the sum of a particle's displacement and that of a contact; d, b: the pair's distance vectors now and
        before; n: the contact's normal."""
        (x, y, z), (nx, ny, nz) = way, n
        if has_friction:
            if depth > zero or pull > zero:
                sx, sy, sz = slip(d[0], d[1], d[2], b[0], b[1], b[2], nx, ny, nz)
                gripped = grip(sx, sy, sz, depth, pull, record[H_STATIC], record[H_DYNAMIC])
                x, y, z = (
                    added_friction(x, fraction, depth, nx, gripped, sx),
                    added_friction(y, fraction, depth, ny, gripped, sy),
                    added_friction(z, fraction, depth, nz, gripped, sz),
                )
                return x, y, z
        return added(x, fraction, depth, nx), added(y, fraction, depth, ny), added(z, fraction, depth, nz)

    def count(position, neighbour_counts, neighbours, record, body, kind, kinds, touching):
        i = np.int32(cuda.grid(1))
        if i < neighbour_counts.size:
            neighbour_count, particles = np.int32(min(neighbour_counts[i], most)), np.int64(neighbour_counts.size)
            if neighbour_count > 0:
                p, contacts = load_quad(position, i), np.int32(0)
                for s in range(neighbour_count):
                    j = neighbours[s * particles + i]
                    q, (row, same) = load_quad(position, j), pair_of(i, j, body, kind, kinds)
                    active = record[row + G_SELF_DISTANCE] if same else record[row + G_ACTIVE]
                    if within(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), active):
                        contacts = np.int32(contacts + 1)
                store_quad(touching, i, p[0], p[1], p[2], p[3] * real(contacts))

    @inlined(math)
    def project_one(i, before, position, neighbour_counts, neighbours, record, kinds_of, touching, written):
        """Project the contacts of particle i; `kinds_of`: (body, kind, kinds); `written`: (travel, pressed, couples)."""
        (body, kind, kinds), (travel, pressed, couples) = kinds_of, written
        if i < neighbour_counts.size:
            neighbour_count, particles = np.int32(min(neighbour_counts[i], most)), np.int64(neighbour_counts.size)
            if neighbour_count > 0:
                p = load_quad(touching, i)
                if p[3] > zero:
                    start, x, y, z = load_quad(before, i), zero, zero, zero
                    u, v, w = zero, zero, zero
                    for s in range(neighbour_count):
                        j = neighbours[s * particles + i]
                        q, (row, same) = load_quad(touching, j), pair_of(i, j, body, kind, kinds)
                        d = p[0] - q[0], p[1] - q[1], p[2] - q[2]
                        active = record[row + G_SELF_DISTANCE] if same else record[row + G_ACTIVE]
                        if within(squared(d[0], d[1], d[2]), active):
                            distance = record[row + G_SELF_DISTANCE] if same else record[row + G_DISTANCE]
                            pull = zero
                            if has_adhesion:
                                if not same:
                                    pull = record[row + G_PULL]
                            other = load_quad(before, j)
                            b = start[0] - other[0], start[1] - other[1], start[2] - other[2]
                            fraction = split(p[3], one, q[3], one)
                            length, nx, ny, nz = direction(d[0], d[1], d[2], distance, i < j)
                            enforced = enforced_distance(distance, b[0], b[1], b[2], record[H_PUSH])
                            depth = depth_of(length, enforced, distance, pull)
                            if has_rigid:
                                k = s * particles + i
                                pressed[k] = pressed_by(pressed[k], fraction, depth)
                            x, y, z = displacement_added((x, y, z), fraction, d, b, depth, pull, (nx, ny, nz), record)
                            if has_couples:
                                u, v, w = lever((u, v, w), fraction, length, d, b, depth, pull, (nx, ny, nz), record)
                    weight = start[3]
                    x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
                    if has_rigid:
                        t = load_quad(travel, i)
                        store_quad(
                            travel, i, carried(t[0], x, p[0]), carried(t[1], y, p[1]), carried(t[2], z, p[2]), t[3]
                        )
                    store_quad(position, i, x, y, z, weight)
                    if has_couples:
                        c = load_quad(couples, i)
                        store_quad(
                            couples,
                            i,
                            gathered(c[0], weight, u),
                            gathered(c[1], weight, v),
                            gathered(c[2], weight, w),
                            zero,
                        )

    def project_soft(before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching):
        i = np.int32(cuda.grid(1))
        project_one(
            i,
            before,
            position,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (touching, touching, touching),
        )

    def project_rigid(
        before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed
    ):
        i = np.int32(cuda.grid(1))
        project_one(
            i,
            before,
            position,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (travel, pressed, touching),
        )

    def project_coupled(before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, couples):
        i = np.int32(cuda.grid(1))
        project_one(
            i,
            before,
            position,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (touching, touching, couples),
        )

    def project_all(
        before, position, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed, couples
    ):
        i = np.int32(cuda.grid(1))
        project_one(
            i,
            before,
            position,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (travel, pressed, couples),
        )

    def clear(neighbour_counts, pressed):
        i = np.int32(cuda.grid(1))
        if i < neighbour_counts.size:
            particles = np.int64(neighbour_counts.size)
            for s in range(np.int32(min(neighbour_counts[i], most))):
                pressed[s * particles + i] = zero

    project: Callable
    if has_couples:
        project = project_all if has_rigid else project_coupled
    else:
        project = project_rigid if has_rigid else project_soft
    project.__name__ = "project"
    words: tuple[str, ...] = (
        "friction" * has_friction,
        "adhesion" * has_adhesion,
        f"own{self_contact:d}",
        f"many{many:d}",
        "rigid" * has_rigid,
    )
    words = *words, "couples" * has_couples
    variant = f"particle_contacts_{variant_name(real, math, *words)}"
    return make_kernels((count, project, clear), variant, **kernel_options(math))


@cache
def make_contact_ends(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the kernels that end a substep: `finish`, `update_velocity` and `collide`.

    `finish(before, position, velocity, contact_record, record, bodies, integers, counter, place, substeps, substep)`:
    velocities, colliders; `update_velocity(before, position, velocity, contact_record, record)`: only velocities;
    `collide(before, position, velocity, record, bodies, integers, counter, place, substeps, substep)`: only colliders.
    The speed limit and sleeping are applied to particles.
    """
    motion, clock = make_motion(real, math, parts, AXES), make_clock(math, parts)
    formulas = device_formulas(particle_contact, real, math)
    far, shortened, rested = formulas.far, formulas.shortened, formulas.rested
    settle, rate_of, touch, zero = motion.settle, motion.rate_of, motion.collide, real(0)
    limited, sleeping = "speed-limit" in parts, "sleeping" in parts

    @inlined(math)
    def calmed(b, p, record):
        x, y, z = p[0], p[1], p[2]
        if limited or sleeping:
            length = far(x - b[0], y - b[1], z - b[2])
            if limited:
                most = record[H_FASTEST]
                x, y, z = (
                    shortened(x, b[0], length, most),
                    shortened(y, b[1], length, most),
                    shortened(z, b[2], length, most),
                )
            if sleeping:
                least = record[H_ASLEEP]
                x, y, z = rested(x, b[0], length, least), rested(y, b[1], length, least), rested(z, b[2], length, least)
        return x, y, z, p[3]

    def finish(
        before, position, velocity, contact_record, record, bodies, integers, counter, place, substeps, substep
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            _, number = clock(counter, place, substeps, substep)
            b, p = load_quad(before, k), load_quad(position, k)
            px, py, pz, vx, vy, vz = settle(b, calmed(b, p, contact_record), World(record[0], bodies, integers), number)
            store_quad(position, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    def update_velocity(before, position, velocity, contact_record, record):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            b = load_quad(before, k)
            p = calmed(b, load_quad(position, k), contact_record)
            vx, vy, vz = rate_of(p, b, record[0])
            store_quad(position, k, p[0], p[1], p[2], b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    def collide(before, position, velocity, record, bodies, integers, counter, place, substeps, substep):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            _, number = clock(counter, place, substeps, substep)
            b, p, v = load_quad(before, k), load_quad(position, k), load_quad(velocity, k)
            px, py, pz, vx, vy, vz = touch(b, p, v[0], v[1], v[2], World(record[0], bodies, integers), number)
            store_quad(position, k, px, py, pz, b[3])
            store_quad(velocity, k, vx, vy, vz, zero)

    name = f"contact_ends_{variant_name(real, math, parts)}"
    return make_kernels((finish, update_velocity, collide), name, **kernel_options(math))
