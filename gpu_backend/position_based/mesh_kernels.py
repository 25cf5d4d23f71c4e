"""CUDA kernels of a mesh's step, one thread per mass: the prediction with all forces, and normals for drawing.

Velocities and colliders are the sheets' (kernels.py); constraints are in core/constraints.py.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.motion import make_motion
from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.forces import make_forces
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import AXES, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.wind import make_block_air
from softlab.model.base.types import Real
from softlab.model.formulas import cloth, distance, wind


@cache
def make_vertex_wind(real: Real, math: str) -> Callable:
    """Make wind_of(position, velocity, k, offsets, at_vertex, corners, parameters, air): the wind over the sheet's mass
    [m/s^2] on vertex k, the sum over its triangles in their order."""
    triangle_wind = device_formulas(wind, real, math).triangle_wind
    mean, inline = device_formulas(cloth, real, math).mean, inlined(math)
    zero, three, one, two = real(0), np.int32(3), np.int32(1), np.int32(2)

    @inline
    def triangle(position, velocity, ia, ib, ic, parameters, air):
        a, b, c = load_quad(position, ia), load_quad(position, ib), load_quad(position, ic)
        u, v, w = load_quad(velocity, ia), load_quad(velocity, ib), load_quad(velocity, ic)
        return triangle_wind(
            (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
            (air[0] - mean(u[0], v[0], w[0]), air[1] - mean(u[1], v[1], w[1]), air[2] - mean(u[2], v[2], w[2])),
            parameters.drag, parameters.lift,
        )  # fmt: skip

    @inline
    def wind_of(position, velocity, k, offsets, at_vertex, corners, parameters, air):
        x, y, z = zero, zero, zero
        for n in range(offsets[k], offsets[k + one]):
            place = three * at_vertex[n]
            fx, fy, fz = triangle(
                position, velocity, corners[place], corners[place + one], corners[place + two], parameters, air
            )  # fmt: skip
            x, y, z = x + fx, y + fy, z + fz
        return x, y, z

    return wind_of


@cache
def make_mesh_begin(real: Real, math: str, parts: frozenset[str]) -> Kernel:
    """Compile begin(position, velocity, predicted, offsets, at_vertex, corners, record, integers, counter, place,
    substeps, substep): it predicts the positions that constraints start from, from the state at the start of the
    substep."""
    forces, predict = make_forces(real, math, parts), make_motion(real, math, parts, AXES).predict
    add_gravity, add, add_particle_force = forces.add_gravity, forces.add, forces.add_particle_force
    wind_of = make_vertex_wind(real, math)
    clock, block_air = make_clock(math, parts), make_block_air(real, math, parts)
    has_wind, zero = "wind" in parts, real(0)

    def begin(
        position, velocity, predicted, offsets, at_vertex, corners, record, integers, counter, place, substeps, substep
    ):  # fmt: skip
        parameters = record[0]
        k = np.int32(cuda.grid(1))
        step, number = clock(counter, place, substeps, substep)
        air = block_air(parameters, integers, number, zero)
        if k < position.size // SIZE:
            p, v = load_quad(position, k), load_quad(velocity, k)
            ax, ay, az = add_gravity(zero, zero, zero, parameters)
            if has_wind:
                fx, fy, fz = wind_of(position, velocity, k, offsets, at_vertex, corners, parameters, air)
                ax, ay, az = add((ax, ay, az), p[3], (fx, fy, fz))
            ax, ay, az = add_particle_force(ax, ay, az, k, p[3], parameters, integers, step)
            x, y, z = predict(p, v, ax, ay, az, parameters)
            store_quad(predicted, k, x, y, z, p[3])

    return make_kernel(begin, f"mesh_{variant_name(real, math, parts)}", **kernel_options(math))


@cache
def make_slow(real: Real, math: str) -> Kernel:
    """Compile slow(velocity, rates, record): velocities after a substep of dampers of `rates` (particles,) [1/s]."""
    slowed = device_formulas(distance, real, math).slowed

    def slow(velocity, rates, record):
        k = np.int32(cuda.grid(1))
        if k < velocity.size // SIZE:
            v, h = load_quad(velocity, k), record[0].dt
            store_quad(
                velocity, k, slowed(v[0], rates[k], h), slowed(v[1], rates[k], h), slowed(v[2], rates[k], h), v[3]
            )

    return make_kernel(slow, f"mesh_{variant_name(real, math)}", **kernel_options(math))
