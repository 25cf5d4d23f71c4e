"""Rebounds between particles on CUDA, after their velocities are known: one thread per particle counts the pairs that
must separate faster, then changes its velocity. All impulses are computed from one state, as in
contact/particles_project.py: a particle with neighbours copies its velocity while it counts."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_find import CAPACITY, pair_of
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, real, routine
from softlab.model.contact.particle_contacts import lack_along
from softlab.model.contact.particle_parameters import G_DISTANCE, G_SELF_DISTANCE
from softlab.model.formulas.particle_contact import added, direction, moved, split, squared
from softlab.model.formulas.particle_contact import touching as touches


@inlined_routine
def lack_of(i, j, state, w, position, old, record, kinds_of, travel, pressed):
    """Return how much faster particle i must separate from j, at the velocity w, and the unit normal from j.

    `state`:
    position, old and new velocity of i; `kinds_of`: (body, kind, kinds); `pressed`: their contact in the substep.

    Particles of rigid bodies have slacks in `travel` (shape_matching/rigid.py).
    """
    (p, o, v), (body, kind, kinds) = state, kinds_of
    q, (row, same) = load_quad(position, j), pair_of(i, j, body, kind, kinds)
    distance = record[row + G_SELF_DISTANCE] if same else record[row + G_DISTANCE]
    dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
    lack, nx, ny, nz = 0.0, 0.0, 0.0, 0.0
    if touches(squared(dx, dy, dz), distance):
        u = load_quad(old, j)
        _, nx, ny, nz = direction(dx, dy, dz, distance, i < j)
        before, now = (o[0] - u[0], o[1] - u[1], o[2] - u[2]), (v[0] - w[0], v[1] - w[1], v[2] - w[2])
        are_rigid = False
        if FEATURE.rigid_bounce:
            are_rigid = load_quad(travel, i)[3] > 0.0 and load_quad(travel, j)[3] > 0.0
        lack = lack_along((nx, ny, nz), before, now, are_rigid, record, pressed)
    return lack, nx, ny, nz


@routine
def count(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed):
    """Write for each particle with neighbours a quad of its velocity and of its weight times the pairs that must
    separate faster. `old`: velocities at the start of the substep; `travel`, `pressed`: of rigid bodies."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], CAPACITY)), np.int64(neighbour_counts.size)
        if neighbour_count > 0:
            p, o, v, pairs = load_quad(position, i), load_quad(old, i), load_quad(velocity, i), np.int32(0)
            for s in range(neighbour_count):
                j = neighbours[s * particles + i]
                w = load_quad(velocity, j)
                by = pressed[s * particles + i] if FEATURE.rigid_bounce else 0.0
                lack, _, _, _ = lack_of(i, j, (p, o, v), w, position, old, record, (body, kind, kinds), travel, by)
                if lack != 0.0:
                    pairs = np.int32(pairs + 1)
            store_quad(touching, i, v[0], v[1], v[2], p[3] * real(pairs))


@routine
def bounce(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching):
    """Change velocities, in place."""
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], CAPACITY)), np.int64(neighbour_counts.size)
        if neighbour_count > 0:
            v = load_quad(touching, i)
            if v[3] > 0.0:
                p, o, x, y, z = load_quad(position, i), load_quad(old, i), 0.0, 0.0, 0.0
                for s in range(neighbour_count):
                    j = neighbours[s * particles + i]
                    w = load_quad(touching, j)
                    lack, nx, ny, nz = lack_of(
                        i, j, (p, o, v), w, position, old, record, (body, kind, kinds), touching, 0.0
                    )
                    if lack > 0.0:
                        fraction = split(v[3], 1.0, w[3], 1.0)
                        x, y = added(x, fraction, lack, nx), added(y, fraction, lack, ny)
                        z = added(z, fraction, lack, nz)
                weight = p[3]
                store_quad(velocity, i, moved(v[0], weight, x), moved(v[1], weight, y), moved(v[2], weight, z), 0.0)


@cache
def make_bounce(real: Real, math: str, self_contact: bool, many: bool, has_rigid: bool = False) -> SimpleNamespace:
    """Compile `count` and `bounce`, or with rigid bodies only `count`. `self_contact`, `many`: of particles_find.py."""
    variant = device_variant(real, math, {"self_contact": self_contact, "kinds": many, "rigid_bounce": has_rigid})
    words = variant_name(real, math, f"own{self_contact:d}", f"many{many:d}", "rigid" * has_rigid)
    return kernels_of(variant, math, (count,) if has_rigid else (count, bounce), f"particle_contacts_{words}")
