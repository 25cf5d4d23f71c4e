"""Operations of implicit Euler on one mass of a cloth in each pass (model/formulas/implicit.py).

Vectors are arrays of quads. The fourth numbers of `x`, the current position at the step's end, and of `base`, the
position without the end velocity, mark pinned masses as in the state: such a mass has no entry in a vector of the
system.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.contact.pins import pin
from softlab.gpu_backend.core.forces import add_particle_force
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.mass_spring.cloth.point import pulls_of, spring_sum, steady
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine
from softlab.model.formulas.implicit import added, applied
from softlab.model.formulas.implicit import residual as missing
from softlab.model.formulas.lengths import dot

end_sum = Open("end_sum: `spring_sum` at the step's end")
product_sum = Open("product_sum: `spring_sum` of the product of the system's matrix with a vector")


class Work(NamedTuple):
    """Arrays of quads of a step (model/formulas/implicit.py): `base`, the position without the end velocity; `x`, `u`,
    position and velocity at the step's end; the residual `r`, the solution `s`, the direction `q`, the products `aq` and
    `ar` with the matrix; `begin`, the velocity with the forces at the step's start."""

    base: np.ndarray
    x: np.ndarray
    u: np.ndarray
    r: np.ndarray
    s: np.ndarray
    q: np.ndarray
    aq: np.ndarray
    ar: np.ndarray
    begin: np.ndarray


@inlined_routine
def added_3(value, factor, other):
    return added(value[0], factor, other[0]), added(value[1], factor, other[1]), added(value[2], factor, other[2])


@inlined_routine
def dot_3(a, b):
    return dot(a[0], a[1], a[2], b[0], b[1], b[2])


@inlined_routine
def product(work, k, cell, system):
    p, v = load_quad(work.x, k), load_quad(work.r, k)
    ax, ay, az = product_sum(work.x, work.r, k, cell, p, v, system)
    mass_entry = system.mass_entry
    wx, wy, wz = applied(v[0], ax, mass_entry), applied(v[1], ay, mass_entry), applied(v[2], az, mass_entry)
    if FEATURE.pins:
        if p[3] != 0.0:
            wx, wy, wz = 0.0, 0.0, 0.0
    store_quad(work.ar, k, wx, wy, wz, 0.0)
    return dot_3(v, v), dot_3(v, (wx, wy, wz))


@inlined_routine
def update(work, k, first, alpha, beta):
    residual_now, applied_now = load_quad(work.r, k), load_quad(work.ar, k)
    direction, applied_direction = (
        (residual_now[0], residual_now[1], residual_now[2]), (applied_now[0], applied_now[1], applied_now[2])
    )  # fmt: skip
    solution = (0.0, 0.0, 0.0)
    if not first:
        direction, applied_direction = (
            added_3(residual_now, beta, load_quad(work.q, k)), added_3(applied_now, beta, load_quad(work.aq, k))
        )  # fmt: skip
        before = load_quad(work.s, k)
        solution = (before[0], before[1], before[2])
    sx, sy, sz = added_3(solution, alpha, direction)
    rx, ry, rz = added_3(residual_now, -alpha, applied_direction)
    store_quad(work.q, k, direction[0], direction[1], direction[2], 0.0)
    store_quad(work.aq, k, applied_direction[0], applied_direction[1], applied_direction[2], 0.0)
    store_quad(work.s, k, sx, sy, sz, 0.0)
    store_quad(work.r, k, rx, ry, rz, 0.0)


@inlined_routine
def put(work, k, p, position, velocity, step, world):
    """Store the current state at the step's end; a pinned mass is at its end position."""
    px, py, pz = position
    vx, vy, vz = velocity
    if FEATURE.pins:
        if p[3] != 0.0:
            px, py, pz, vx, vy, vz = pin(p[3], p, step, False, world)
    store_quad(work.x, k, px, py, pz, p[3])
    store_quad(work.u, k, vx, vy, vz, 0.0)
    return (px, py, pz), (vx, vy, vz)


@inlined_routine
def start(position, velocity, work, k, cell, world, step, air):
    parameters, integers = world.parameters, world.integers
    p, v = load_quad(position, k), load_quad(velocity, k)
    ax, ay, az = steady(position, velocity, k, cell, p, v, parameters, air)
    ax, ay, az = add_particle_force(ax, ay, az, k, 0.0, parameters, integers, step)
    bx, by, bz = added_3(v, parameters.dt, (ax, ay, az))
    store_quad(work.begin, k, bx, by, bz, 0.0)
    end, speed = put(work, k, p, (p[0], p[1], p[2]), (0.0, 0.0, 0.0), step, world)
    px, py, pz = added_3(end, -parameters.dt, speed)
    store_quad(work.base, k, px, py, pz, p[3])


@inlined_routine
def residual(work, k, cell, parameters, system):
    p, v, b = load_quad(work.base, k), load_quad(work.u, k), load_quad(work.begin, k)
    ax, ay, az = end_sum(work.base, work.u, k, cell, p, v, parameters)
    dt, rate = system.dt, system.damping_of_step
    rx, ry, rz = (
        missing(b[0], v[0], ax, dt, rate), missing(b[1], v[1], ay, dt, rate), missing(b[2], v[2], az, dt, rate),
    )  # fmt: skip
    if FEATURE.pins:
        if p[3] != 0.0:
            rx, ry, rz = 0.0, 0.0, 0.0
    store_quad(work.r, k, rx, ry, rz, 0.0)
    r = (rx, ry, rz)
    return dot_3(r, r), dot_3(r, load_quad(work.s, k)), dot_3(v, v)


@inlined_routine
def move(position, work, k, back, step, world):
    parameters = world.parameters
    p, v, search = load_quad(position, k), load_quad(work.u, k), load_quad(work.s, k)
    sx, sy, sz, sign = search[0], search[1], search[2], 1.0
    if back:
        sx, sy, sz, sign = 0.5 * sx, 0.5 * sy, 0.5 * sz, -1.0
        store_quad(work.s, k, sx, sy, sz, 0.0)
    new = added_3(v, sign, (sx, sy, sz))
    put(work, k, p, added_3(p, parameters.dt, new), new, step, world)


@inlined_routine
def finish(position, velocity, work, k, step, world):
    p, new, v = load_quad(position, k), load_quad(work.x, k), load_quad(work.u, k)
    px, py, pz, vx, vy, vz = collide(p, new[0], new[1], new[2], v[0], v[1], v[2], world, step)
    if FEATURE.pins:
        if p[3] != 0.0:
            px, py, pz, vx, vy, vz = new[0], new[1], new[2], v[0], v[1], v[2]
    store_quad(position, k, px, py, pz, p[3])
    store_quad(velocity, k, vx, vy, vz, 0.0)


def implicit_sums(parts: frozenset[str]) -> dict[str, object]:
    """Return the functions for the open names of this file."""
    return {f"{system}_sum": filled(spring_sum, pulls_of(parts, system)) for system in ("end", "product")}
