"""CUDA kernels of a mesh's step, one thread per mass: the prediction with all forces, and normals for drawing.

Velocities and colliders are the sheets' (kernels.py); constraints are in core/constraints.py.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import predict
from softlab.gpu_backend.core.compile import Kernel, kernels_of, variant_name
from softlab.gpu_backend.core.forces import add, add_gravity, add_particle_force, particle_features, with_forces
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import block_air
from softlab.gpu_backend.position_based.gather import ONE, TWO
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.formulas.cloth import mean
from softlab.model.formulas.distance import slowed
from softlab.model.formulas.wind import triangle_wind

THREE = np.int32(3)


@inlined_routine
def triangle(position, velocity, ia, ib, ic, parameters, air):
    """Return the wind on each corner of a triangle."""
    a, b, c = load_quad(position, ia), load_quad(position, ib), load_quad(position, ic)
    u, v, w = load_quad(velocity, ia), load_quad(velocity, ib), load_quad(velocity, ic)
    return triangle_wind(
        (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
        (air[0] - mean(u[0], v[0], w[0]), air[1] - mean(u[1], v[1], w[1]), air[2] - mean(u[2], v[2], w[2])),
        parameters.drag, parameters.lift,
    )  # fmt: skip


@inlined_routine
def wind_of(position, velocity, k, offsets, at_vertex, corners, parameters, air):
    """Return the wind over the sheet's mass [m/s^2] on vertex k, the sum over its triangles in their order."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(offsets[k], offsets[k + ONE]):
        place = THREE * at_vertex[n]
        fx, fy, fz = triangle(
            position, velocity, corners[place], corners[place + ONE], corners[place + TWO], parameters, air
        )  # fmt: skip
        x, y, z = x + fx, y + fy, z + fz
    return x, y, z


@routine
def begin(
    position, velocity, predicted, offsets, at_vertex, corners, record, integers, counter, place, substeps, substep
):  # fmt: skip
    """Predict the positions that constraints start from, from the state at the start of the substep."""
    parameters = record[0]
    k = np.int32(cuda.grid(1))
    step, number = clock(counter, place, substeps, substep)
    air = block_air(parameters, integers, number, 0.0)
    if k < position.size // SIZE:
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = add_gravity(0.0, 0.0, 0.0, parameters)
        if FEATURE.wind:
            fx, fy, fz = wind_of(position, velocity, k, offsets, at_vertex, corners, parameters, air)
            ax, ay, az = add((ax, ay, az), p[3], (fx, fy, fz))
        ax, ay, az = add_particle_force(ax, ay, az, k, p[3], parameters, integers, step)
        x, y, z = predict(p, v, ax, ay, az, parameters)
        store_quad(predicted, k, x, y, z, p[3])


@cache
def make_mesh_begin(real: Real, math: str, parts: frozenset[str]) -> Kernel:
    """Compile `begin`."""
    variant, label = device_variant(real, math, particle_features(parts)), f"mesh_{variant_name(real, math, parts)}"
    return kernels_of(variant, math, [with_forces(begin, parts)], label).begin


@routine
def slow(velocity, rates, record):
    """Write velocities after a substep of dampers of `rates` (particles,) [1/s]."""
    k = np.int32(cuda.grid(1))
    if k < velocity.size // SIZE:
        v, h = load_quad(velocity, k), record[0].dt
        store_quad(velocity, k, slowed(v[0], rates[k], h), slowed(v[1], rates[k], h), slowed(v[2], rates[k], h), v[3])


@cache
def make_slow(real: Real, math: str) -> Kernel:
    """Compile `slow`."""
    return kernels_of(device_variant(real, math), math, [slow], f"mesh_{variant_name(real, math)}").slow
