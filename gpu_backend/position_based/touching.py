"""CUDA kernels of colliders that act before each iteration of a position-based step, one thread per mass."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import collide, rate_of
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.forces import particle_features
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.model.base.types import Real
from softlab.model.base.variant import routine


@routine
def touch(before, position, pushes, record, bodies, integers, counter, place, substeps, substep):
    """Write positions after colliders; `pushes` (quads) [m]: their displacement by colliders so far.

    Colliders act on the position without it, so that they act on a mass with all that constraints did to it since the
    substep began.
    """
    world = World(record[0], bodies, integers)
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        _, number = clock(counter, place, substeps, substep)
        b, p = load_quad(before, k), load_quad(position, k)
        if b[3] != 0.0:
            q = load_quad(pushes, k)
            p = p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3]
            vx, vy, vz = rate_of(p, b, world.parameters)
            x, y, z, _, _, _ = collide(b, p, vx, vy, vz, world, number)
            store_quad(position, k, x, y, z, p[3])
            store_quad(pushes, k, x - p[0], y - p[1], z - p[2], 0.0)


@routine
def release(position, pushes):
    """Write positions without `pushes`, for velocities and colliders of the substep's end; `pushes` are 0 then."""
    k = np.int32(cuda.grid(1))
    if k < position.size // SIZE:
        p, q = load_quad(position, k), load_quad(pushes, k)
        store_quad(position, k, p[0] - q[0], p[1] - q[1], p[2] - q[2], p[3])
        store_quad(pushes, k, 0.0, 0.0, 0.0, 0.0)


@cache
def make_touching(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `touch` and `release`."""
    variant = device_variant(real, math, particle_features(parts - {"restitution"}))  # velocities are the end's
    return kernels_of(variant, math, (touch, release), f"touching_{variant_name(real, math, parts)}")
