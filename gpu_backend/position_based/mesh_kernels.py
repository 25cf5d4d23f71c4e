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
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.formulas.distance import slowed
from softlab.model.position_based import mesh_wind

THREE = np.int32(3)


@inlined_routine
def row(array, k):
    p = load_quad(array, k)
    return p[0], p[1], p[2]


@inlined_routine
def corners_of(corners, triangle):
    place = THREE * triangle
    return corners[place], corners[place + ONE], corners[place + TWO]


wind_of = filled(mesh_wind.wind_of, {"row": row, "corners_of": corners_of})


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
            fx, fy, fz = wind_of(k, air, position, velocity, parameters, (offsets, at_vertex, corners))
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
