"""CUDA kernels of rebounds between rigid bodies: the impulses on their particles, scaled for each pair by the response
of both bodies (model/shape_matching/rigid_rebound.py)."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.particles_bounce import lack_of
from softlab.gpu_backend.core.compile import Kernel, kernel_options, kernels_of, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import ROWS, SIZE, load_quad, store_quad
from softlab.gpu_backend.shape_matching.kernels import ONE, motion_of
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.contact.particle_parameters import H_INVERSE_SUBSTEP, H_RESTITUTION, MAX_NEIGHBOURS
from softlab.model.formulas.particle_contact import impulse as impulse_of
from softlab.model.formulas.particle_contact import impulse_added, moved, split
from softlab.model.formulas.shape_matching.rebound import joined, scaled, shared, squared, wanted
from softlab.model.shape_matching.motions import velocity_at

MOST = np.int32(MAX_NEIGHBOURS)


@routine
def give(
    position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel, pressed,
    scales, impulses
):  # fmt: skip
    """Write the velocity changes by separating contacts into `impulses`; otherwise as `bounce` of
    contact/particles_bounce.py.

    If they are `scaled`, impulses are multiplied by the smaller one of both particles' `scales`.
    """
    i = np.int32(cuda.grid(1))
    if i < neighbour_counts.size:
        neighbour_count, particles = np.int32(min(neighbour_counts[i], MOST)), np.int64(neighbour_counts.size)
        x, y, z, weight, squares, contacts = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if neighbour_count > 0:
            v = load_quad(touching, i)
            if v[3] > 0.0:
                p, o = load_quad(position, i), load_quad(old, i)
                weight = p[3]
                for s in range(neighbour_count):
                    j = neighbours[s * particles + i]
                    w = load_quad(touching, j)
                    by = pressed[s * particles + i]
                    lack, nx, ny, nz = lack_of(
                        i, j, (p, o, v), w, position, old, record, (body, kind, kinds), travel, by
                    )
                    if lack != 0.0:
                        fraction = split(v[3], 1.0, w[3], 1.0)
                        if FEATURE.scaled:
                            f, g = load_quad(scales, i), load_quad(scales, j)
                            lack = scaled(lack, shared(record[H_RESTITUTION], f[0], f[1], f[2], g[0], g[1], g[2]))
                        impulse = impulse_of(fraction, lack, max(by, 0.0), record[H_INVERSE_SUBSTEP])
                        x, y, z = (
                            impulse_added(x, impulse, nx),
                            impulse_added(y, impulse, ny),
                            impulse_added(z, impulse, nz),
                        )
                        squares, contacts = squared(squares, impulse), contacts + 1.0
        asked = wanted(weight, contacts, squares)
        store_quad(impulses, i, moved(0.0, weight, x), moved(0.0, weight, y), moved(0.0, weight, z), asked)


@routine
def spread(particle_starts, particle_clusters, limits, motions, scales):
    """Write each particle's scale, that of its body, 1 without one."""
    k = np.int32(cuda.grid(1))
    if k < scales.size // SIZE:
        most, asked, worth = 1.0, 0.0, 0.0
        for n in range(particle_starts[k], particle_starts[k + ONE]):
            if limits[particle_clusters[n]] != 0.0:
                o = load_quad(motions, np.int32(ROWS * particle_clusters[n]))
                most, asked, worth = o[0], o[1], o[2]
        store_quad(scales, k, most, asked, worth, 0.0)


@routine
def join(position, velocity, impulses, particle_starts, particle_clusters, limits, motions):
    """Add to velocities the motions of the bodies, or the impulse `impulses` for a particle without a body."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, v, q = load_quad(position, k), load_quad(velocity, k), load_quad(impulses, k)
        a, b, c = q[0], q[1], q[2]
        for n in range(particle_starts[k], particle_starts[k + ONE]):
            if limits[particle_clusters[n]] != 0.0:
                a, b, c = velocity_at(motion_of(motions, particle_clusters[n]), p[0], p[1], p[2])
        store_quad(velocity, k, joined(v[0], a), joined(v[1], b), joined(v[2], c), 0.0)


@cache
def make_give(real: Real, math: str, self_contact: bool, many: bool, scaled: bool) -> Kernel:
    """Compile give(position, old, velocity, neighbour_counts, neighbours, record, body, kind, kinds, touching, travel,
    pressed, scales, impulses)."""
    features = {"self_contact": self_contact, "kinds": many, "rigid_bounce": True, "scaled": scaled}
    name = variant_name(real, math, f"own{self_contact:d}", f"many{many:d}", f"scaled{scaled:d}")
    kernel = device_variant(real, math, features).copied(give)
    return make_kernel(kernel, f"bodies_bounce_{name}", **kernel_options(math))


@cache
def make_bodies_bounce(real: Real, math: str) -> SimpleNamespace:
    """Compile `spread(particle_starts, particle_clusters, limits, motions, scales)` and `join(position, velocity,
    impulses, particle_starts, particle_clusters, limits, motions)`."""
    label = f"bodies_bounce_{variant_name(real, math)}"
    return kernels_of(device_variant(real, math), math, (spread, join), label)
