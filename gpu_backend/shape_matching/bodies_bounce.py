"""CUDA kernels of rebounds between rigid bodies: the impulses on their particles, scaled for each pair by the response
of both bodies (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_bounce import make_lack
from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import ROWS, SIZE, load_quad, store_quad
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import H_INVERSE_SUBSTEP, H_RESTITUTION, MAX_NEIGHBOURS
from softlab.model.formulas import particle_contact
from softlab.model.formulas.shape_matching import rebound


@cache
def make_give(real: Real, math: str, self_contact: bool, many: bool, scaled: bool) -> Kernel:
    """Compile give(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel,
    pressed, scales, impulses).

    It writes the velocity changes by separating contacts into `impulses`; otherwise as `bounce` of
    contact/particles_bounce.py. `scaled`: impulses are multiplied by the smaller one of both particles' `scales`.
    """
    formulas = device_formulas(particle_contact, real, math)
    split, moved, impulse_of, add = formulas.split, formulas.moved, formulas.impulse, formulas.impulse_added
    whole = device_formulas(rebound, real, math)
    factor_of, product, squared_impulse, wanted = whole.shared, whole.scaled, whole.squared, whole.wanted
    lack_of, zero, one, most = (
        make_lack(real, math, self_contact, many, True),
        real(0),
        real(1),
        np.int32(MAX_NEIGHBOURS),
    )

    def give(
        position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed,
        scales, impulses
    ):  # fmt: skip
        i = np.int32(cuda.grid(1))
        if i < neighbour_counts.size:
            neighbour_count, particles = np.int32(min(neighbour_counts[i], most)), np.int64(neighbour_counts.size)
            x, y, z, weight, squares, contacts = zero, zero, zero, zero, zero, zero
            if neighbour_count > 0:
                v = load_quad(touching, i)
                if v[3] > zero:
                    p, o = load_quad(position, i), load_quad(old, i)
                    weight = p[3]
                    for s in range(neighbour_count):
                        j = neighbours[s * particles + i]
                        w = load_quad(touching, j)
                        by = pressed[s * particles + i]
                        lack, nx, ny, nz = lack_of(
                            i, j, (p, o, v), w, position, old, record, (body, kind, kinds), travel, by
                        )
                        if lack != zero:
                            fraction = split(v[3], one, w[3], one)
                            if scaled:
                                f, g = load_quad(scales, i), load_quad(scales, j)
                                lack = product(
                                    lack, factor_of(record[H_RESTITUTION], f[0], f[1], f[2], g[0], g[1], g[2])
                                )
                            impulse = impulse_of(fraction, lack, max(by, zero), record[H_INVERSE_SUBSTEP])
                            x, y, z = add(x, impulse, nx), add(y, impulse, ny), add(z, impulse, nz)
                            squares, contacts = squared_impulse(squares, impulse), contacts + one
            asked = wanted(weight, contacts, squares)
            store_quad(impulses, i, moved(zero, weight, x), moved(zero, weight, y), moved(zero, weight, z), asked)

    name = variant_name(real, math, f"own{self_contact:d}", f"many{many:d}", f"scaled{scaled:d}")
    return make_kernel(give, f"bodies_bounce_{name}", **kernel_options(math))


@cache
def make_bodies_bounce(real: Real, math: str) -> SimpleNamespace:
    """Compile `spread(particle_starts, particle_clusters, limits, motions, scales)`, each particle's scale, that of its
    body, 1 without one, and `join(position, velocity, impulses, particle_starts, particle_clusters, limits, motions)`.

    `join` adds to velocities the motions of the bodies, or the impulse `impulses` for a particle without a body.
    """
    formulas = device_formulas(rebound, real, math)
    rigid, joined, zero, one = formulas.rigid, formulas.joined, real(0), np.int32(1)
    unit = real(1)

    def spread(particle_starts, particle_clusters, limits, motions, scales):
        k = np.int32(cuda.grid(1))
        if k < scales.size // SIZE:
            most, asked, worth = unit, zero, zero
            for n in range(particle_starts[k], particle_starts[k + one]):
                if limits[particle_clusters[n]] != zero:
                    o = load_quad(motions, np.int32(ROWS * particle_clusters[n]))
                    most, asked, worth = o[0], o[1], o[2]
            store_quad(scales, k, most, asked, worth, zero)

    def join(position, velocity, impulses, particle_starts, particle_clusters, limits, motions):
        k = np.int32(cuda.grid(1))
        if k < position.size // SIZE:
            p, v, q = load_quad(position, k), load_quad(velocity, k), load_quad(impulses, k)
            a, b, c = q[0], q[1], q[2]
            for n in range(particle_starts[k], particle_starts[k + one]):
                if limits[particle_clusters[n]] != zero:
                    row = np.int32(ROWS * particle_clusters[n])
                    o, t, s = load_quad(motions, row), load_quad(motions, row + 1), load_quad(motions, row + 2)
                    dx, dy, dz = p[0] - o[0], p[1] - o[1], p[2] - o[2]
                    a = rigid(t[0], s[1], dz, s[2], dy)
                    b = rigid(t[1], s[2], dx, s[0], dz)
                    c = rigid(t[2], s[0], dy, s[1], dx)
            store_quad(velocity, k, joined(v[0], a), joined(v[1], b), joined(v[2], c), zero)

    return make_kernels((spread, join), f"bodies_bounce_{variant_name(real, math)}", **kernel_options(math))
