"""Operations of implicit Euler on one mass of a cloth in each pass, as device functions (model/formulas/implicit.py).

Vectors are arrays of quads. The fourth numbers of `x`, the current position at the step's end, and of `base`, the
position without the end velocity, mark pinned masses as in the state: such a mass has no entry in a vector of the
system.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.contact.pins import make_pins
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.gpu_backend.mass_spring.cloth.point import make_cloth_forces, make_cloth_springs
from softlab.model.base.types import Real
from softlab.model.formulas import implicit, lengths
from softlab.model.tables.cloth import SPRING_KINDS


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


def _make_vectors(real: Real, math: str) -> SimpleNamespace:
    """Make `added_3`, value + factor other, `dot_3`, and along one axis `applied`, `missing`."""
    formulas, inline = device_formulas(implicit, real, math), inlined(math)
    added, dot = formulas.added, device_formulas(lengths, real, math).dot

    @inline
    def added_3(value, factor, other):
        return added(value[0], factor, other[0]), added(value[1], factor, other[1]), added(value[2], factor, other[2])

    @inline
    def dot_3(a, b):
        return dot(a[0], a[1], a[2], b[0], b[1], b[2])

    return SimpleNamespace(added_3=added_3, dot_3=dot_3, applied=formulas.applied, missing=formulas.residual)


def _make_iteration(
    real: Real, math: str, springs: frozenset[str], has_pins: bool, vectors: Any
) -> tuple[Callable, Callable]:
    """Make `product` and `update`, the two passes of an iteration of conjugate gradients."""
    product_sum = make_cloth_springs(real, math, springs, "product")
    applied, added_3, dot_3 = vectors.applied, vectors.added_3, vectors.dot_3
    zero, inline = real(0), inlined(math)

    @inline
    def product(work, k, cell, system):
        p, v = load_quad(work.x, k), load_quad(work.r, k)
        ax, ay, az = product_sum(work.x, work.r, k, cell, p, v, system)
        mass_entry = system.mass_entry
        wx, wy, wz = applied(v[0], ax, mass_entry), applied(v[1], ay, mass_entry), applied(v[2], az, mass_entry)
        if has_pins:
            if p[3] != zero:
                wx, wy, wz = zero, zero, zero
        store_quad(work.ar, k, wx, wy, wz, zero)
        return dot_3(v, v), dot_3(v, (wx, wy, wz))

    @inline
    def update(work, k, first, alpha, beta):
        residual_now, applied_now = load_quad(work.r, k), load_quad(work.ar, k)
        direction, applied_direction = (
            (residual_now[0], residual_now[1], residual_now[2]), (applied_now[0], applied_now[1], applied_now[2])
        )  # fmt: skip
        solution = (zero, zero, zero)
        if not first:
            direction, applied_direction = (
                added_3(residual_now, beta, load_quad(work.q, k)), added_3(applied_now, beta, load_quad(work.aq, k))
            )  # fmt: skip
            before = load_quad(work.s, k)
            solution = (before[0], before[1], before[2])
        sx, sy, sz = added_3(solution, alpha, direction)
        rx, ry, rz = added_3(residual_now, -alpha, applied_direction)
        store_quad(work.q, k, direction[0], direction[1], direction[2], zero)
        store_quad(work.aq, k, applied_direction[0], applied_direction[1], applied_direction[2], zero)
        store_quad(work.s, k, sx, sy, sz, zero)
        store_quad(work.r, k, rx, ry, rz, zero)

    return product, update


@cache
def make_implicit_point(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the passes of mass k in row i and column j, by name; `residual` and `product` return summands."""
    springs = frozenset(part for part in parts if part.split("-")[0] in SPRING_KINDS)
    elsewhere, collide = make_cloth_forces(real, math, parts - springs), make_collide(real, math, parts)
    steady, add_particle_force = elsewhere.steady, elsewhere.add_particle_force
    pull_sum, pin = make_cloth_springs(real, math, springs, "end"), make_pins(real, math, parts).pin
    vectors, has_pins = _make_vectors(real, math), "pins" in parts
    added_3, dot_3, missing = vectors.added_3, vectors.dot_3, vectors.missing
    zero, half, one, inline = real(0), real(0.5), real(1), inlined(math)

    @inline
    def put(work, k, p, position, velocity, step, world):
        """Store the current state at the step's end; a pinned mass is at its end position."""
        px, py, pz = position
        vx, vy, vz = velocity
        if has_pins:
            if p[3] != zero:
                px, py, pz, vx, vy, vz = pin(p[3], p, step, False, world)
        store_quad(work.x, k, px, py, pz, p[3])
        store_quad(work.u, k, vx, vy, vz, zero)
        return (px, py, pz), (vx, vy, vz)

    @inline
    def start(position, velocity, work, k, cell, world, step, air):
        parameters, integers = world.parameters, world.integers
        p, v = load_quad(position, k), load_quad(velocity, k)
        ax, ay, az = steady(position, velocity, k, cell, p, v, parameters, air)
        ax, ay, az = add_particle_force(ax, ay, az, k, zero, parameters, integers, step)
        bx, by, bz = added_3(v, parameters.dt, (ax, ay, az))
        store_quad(work.begin, k, bx, by, bz, zero)
        end, speed = put(work, k, p, (p[0], p[1], p[2]), (zero, zero, zero), step, world)
        px, py, pz = added_3(end, -parameters.dt, speed)
        store_quad(work.base, k, px, py, pz, p[3])

    @inline
    def residual(work, k, cell, parameters, system):
        p, v, b = load_quad(work.base, k), load_quad(work.u, k), load_quad(work.begin, k)
        ax, ay, az = pull_sum(work.base, work.u, k, cell, p, v, parameters)
        dt, rate = system.dt, system.damping_of_step
        rx, ry, rz = (
            missing(b[0], v[0], ax, dt, rate), missing(b[1], v[1], ay, dt, rate), missing(b[2], v[2], az, dt, rate),
        )  # fmt: skip
        if has_pins:
            if p[3] != zero:
                rx, ry, rz = zero, zero, zero
        store_quad(work.r, k, rx, ry, rz, zero)
        residual = (rx, ry, rz)
        return dot_3(residual, residual), dot_3(residual, load_quad(work.s, k)), dot_3(v, v)

    @inline
    def move(position, work, k, back, step, world):
        parameters = world.parameters
        p, v, search = load_quad(position, k), load_quad(work.u, k), load_quad(work.s, k)
        sx, sy, sz, sign = search[0], search[1], search[2], one
        if back:
            sx, sy, sz, sign = half * sx, half * sy, half * sz, -one
            store_quad(work.s, k, sx, sy, sz, zero)
        new = added_3(v, sign, (sx, sy, sz))
        put(work, k, p, added_3(p, parameters.dt, new), new, step, world)

    @inline
    def finish(position, velocity, work, k, step, world):
        p, new, v = load_quad(position, k), load_quad(work.x, k), load_quad(work.u, k)
        px, py, pz, vx, vy, vz = collide(p, new[0], new[1], new[2], v[0], v[1], v[2], world, step)
        if has_pins:
            if p[3] != zero:
                px, py, pz, vx, vy, vz = new[0], new[1], new[2], v[0], v[1], v[2]
        store_quad(position, k, px, py, pz, p[3])
        store_quad(velocity, k, vx, vy, vz, zero)

    product, update = _make_iteration(real, math, springs, has_pins, vectors)
    return SimpleNamespace(
        start=start, residual=residual, product=product, update=update, move=move, finish=finish,
        air_now=elsewhere.air_now,
    )  # fmt: skip
