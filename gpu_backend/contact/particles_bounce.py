"""Rebounds between particles on CUDA, after their velocities are known: one thread per particle counts the pairs that
must separate faster, then changes its velocity. All impulses are computed from one state, as in
contact/particles_project.py: a particle with neighbours copies its velocity while it counts."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_find import make_pairs
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import (
    G_DISTANCE,
    G_SELF_DISTANCE,
    H_RESTITUTION,
    H_SETTLING,
    MAX_NEIGHBOURS,
)
from softlab.model.formulas import particle_contact


@cache
def make_lack(real: Real, math: str, self_contact: bool, many: bool, has_rigid: bool = False) -> Callable:
    """Make lack_of(i, j, state, w, position, old, record, kinds_of, travel, pressed): see the inner function.

    `has_rigid`: `travel` is read, as in shape_matching/rigid.py. Two particles of rigid bodies, which have slacks, then
    separate as those do (model/formulas/particle_contact.py, `parting`), even without restitution.
    """
    formulas = device_formulas(particle_contact, real, math)
    squared, touches = formulas.squared, formulas.touching
    direction, lacking, parting = formulas.direction, formulas.lacking, formulas.parting
    pair_of, zero = make_pairs(self_contact, many), real(0)

    @inlined(math)
    def lack_of(i, j, state, w, position, old, record, kinds_of, travel, pressed):
        """Return how much faster particle i must separate from j, at the velocity w, and the unit normal from j; `state`:
        position, old and new velocity of i; `kinds_of`: (body, kind, kinds); `pressed`: their contact in the substep."""
        (p, o, v), (body, kind, kinds) = state, kinds_of
        q, (row, same) = load_quad(position, j), pair_of(i, j, body, kind, kinds)
        distance = record[row + G_SELF_DISTANCE] if same else record[row + G_DISTANCE]
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        lack, nx, ny, nz = zero, zero, zero, zero
        if touches(squared(dx, dy, dz), distance):
            u = load_quad(old, j)
            _, nx, ny, nz = direction(dx, dy, dz, distance, i < j)
            before, now, n = (
                (o[0] - u[0], o[1] - u[1], o[2] - u[2]),
                (v[0] - w[0], v[1] - w[1], v[2] - w[2]),
                (nx, ny, nz),
            )
            e, settling = record[H_RESTITUTION], record[H_SETTLING]
            if has_rigid:
                if load_quad(travel, i)[3] > zero and load_quad(travel, j)[3] > zero:
                    lack = parting(before, now, n, e, settling, pressed)
                elif e > zero:
                    lack = lacking(before, now, n, e, settling)
            else:
                lack = lacking(before, now, n, e, settling)
        return lack, nx, ny, nz

    return lack_of


@cache
def make_bounce(real: Real, math: str, self_contact: bool, many: bool, has_rigid: bool = False) -> SimpleNamespace:
    """Compile `count` and `bounce`, both (position, old, velocity, found, neighbours, record, body, kind, kinds,
    touching).

    `count`: for each particle with neighbours a quad of its velocity and of its weight times the pairs that must
    separate faster. `bounce`: velocities, in place. `old`: velocities at the start of the substep; `self_contact`,
    `many`: as in `make_pairs`. With `has_rigid` only `count`, whose last arguments are `travel` and `pressed`, as of
    `make_lack` and contact/particles_project.py.
    """
    formulas = device_formulas(particle_contact, real, math)
    split, added, moved = formulas.split, formulas.added, formulas.moved
    lack_of, zero, one, most = (
        make_lack(real, math, self_contact, many, has_rigid),
        real(0),
        real(1),
        np.int32(MAX_NEIGHBOURS),
    )

    @inlined(math)
    def count_one(i, position, old, velocity, neighbour_counts, neighbours, record, kinds_of, touching, rigid):
        travel, pressed = rigid
        if i < neighbour_counts.size:
            neighbour_count, particles = np.int32(min(neighbour_counts[i], most)), np.int64(neighbour_counts.size)
            if neighbour_count > 0:
                p, o, v, pairs = load_quad(position, i), load_quad(old, i), load_quad(velocity, i), np.int32(0)
                for s in range(neighbour_count):
                    j = neighbours[s * particles + i]
                    w = load_quad(velocity, j)
                    by = pressed[s * particles + i] if has_rigid else zero
                    lack, _, _, _ = lack_of(i, j, (p, o, v), w, position, old, record, kinds_of, travel, by)
                    if lack != zero:
                        pairs = np.int32(pairs + 1)
                store_quad(touching, i, v[0], v[1], v[2], p[3] * real(pairs))

    def count_soft(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching):
        i = np.int32(cuda.grid(1))
        count_one(
            i,
            position,
            old,
            velocity,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (touching, touching),
        )

    def count_rigid(
        position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed
    ):
        i = np.int32(cuda.grid(1))
        count_one(
            i,
            position,
            old,
            velocity,
            neighbour_counts,
            neighbours,
            record,
            (body, kind, kinds),
            touching,
            (travel, pressed),
        )

    def bounce(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching):
        i = np.int32(cuda.grid(1))
        if i < neighbour_counts.size:
            neighbour_count, particles = np.int32(min(neighbour_counts[i], most)), np.int64(neighbour_counts.size)
            if neighbour_count > 0:
                v = load_quad(touching, i)
                if v[3] > zero:
                    p, o, x, y, z = load_quad(position, i), load_quad(old, i), zero, zero, zero
                    for s in range(neighbour_count):
                        j = neighbours[s * particles + i]
                        w = load_quad(touching, j)
                        lack, nx, ny, nz = lack_of(
                            i, j, (p, o, v), w, position, old, record, (body, kind, kinds), touching, zero
                        )
                        if lack > zero:
                            fraction = split(v[3], one, w[3], one)
                            x, y, z = (
                                added(x, fraction, lack, nx),
                                added(y, fraction, lack, ny),
                                added(z, fraction, lack, nz),
                            )
                    weight = p[3]
                    store_quad(
                        velocity, i, moved(v[0], weight, x), moved(v[1], weight, y), moved(v[2], weight, z), zero
                    )

    count = count_rigid if has_rigid else count_soft
    count.__name__ = "count"
    variant = (
        f"particle_contacts_{variant_name(real, math, f'own{self_contact:d}', f'many{many:d}', 'rigid' * has_rigid)}"
    )
    return make_kernels((count,) if has_rigid else (count, bounce), variant, **kernel_options(math))
