"""Operations of a position-based solver on one mass, as device functions: its prediction, and its velocity afterwards.

Masses are quads: x, y, z and the weight w, 0 if pinned, 1, or the sheet's mass over the mass's own if the scene has a
`load`. In a plane z stays 0 and is not computed. xpbd/constraints.py and gather.py have constraints.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.forces import make_forces
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad
from softlab.gpu_backend.mass_spring.cloth.point import make_wind
from softlab.model.formulas import distance


@cache
def make_accelerations(real: Any, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the accelerations of a sheet's mass without constraints, each (ax, ay, az, ...) -> (ax, ay, az) [m/s^2]:
    `add_wind`; and `accelerate`, wind and own forces."""
    forces, wind_sum = make_forces(real, math, parts), make_wind(real, math, parts).wind_sum
    add, add_gravity, add_own = forces.add, forces.add_gravity, forces.add_own
    inline, has_wind, zero = inlined(math), "wind" in parts, real(0)

    @inline
    def add_wind(ax, ay, az, position, velocity, k, cell, p, v, parameters, air):
        if has_wind:
            fx, fy, fz = wind_sum(position, velocity, k, cell, p, v, parameters, air)
            ax, ay, az = add((ax, ay, az), p[3], (fx, fy, fz))
        return ax, ay, az

    @inline
    def accelerate(position, velocity, k, cell, p, v, parameters, integers, step, air):
        """Return the acceleration of mass k in row i, column j, at p and with velocity v (quads), at the start of the
        substep."""
        ax, ay, az = add_gravity(zero, zero, zero, parameters)
        ax, ay, az = add_wind(ax, ay, az, position, velocity, k, cell, p, v, parameters, air)
        return add_own(ax, ay, az, k, p[3], parameters, integers, step)

    return SimpleNamespace(add_wind=add_wind, accelerate=accelerate)


@cache
def make_motion(real: Any, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Make `predict`, `kick`, `rate_of`, `collide` and `settle`.

    `predict(p, v, ax, ay, az, parameters)` -> (x, y, z): the position without constraints; `kick(p, v, ax, ay, az,
    parameters)` -> the velocity of the prediction; `rate_of(p, b, parameters)` -> the velocity from b to p (quads);
    `collide(b, p, vx, vy, vz, world, number)` -> (x, y, z, vx, vy, vz): after the colliders, in substep `number`;
    `settle`: the last two, from the substep's start and end.
    """
    formulas = device_formulas(distance.make, real, math)
    kicked, kept, predicted, rate = formulas.kicked, formulas.kept, formulas.predicted, formulas.rate
    touch = make_collide(real, math, parts)
    inline = inlined(math)
    has_pins, has_load, has_damping, solid = "pins" in parts, "load" in parts, "damping" in parts, axes == 3
    zero, one = real(0), real(1)

    @inline
    def predict(p, v, ax, ay, az, parameters):
        h, keep = parameters.dt, one
        if has_damping:
            keep = kept(parameters.braking, p[3]) if has_load else parameters.keep
        x = predicted(p[0], h, kicked(v[0], keep, h, ax))
        y = predicted(p[1], h, kicked(v[1], keep, h, ay))
        z = p[2]
        if solid:
            z = predicted(z, h, kicked(v[2], keep, h, az))
        if has_pins:
            if p[3] == zero:
                x, y, z = p[0], p[1], p[2]
        return x, y, z

    @inline
    def kick(p, v, ax, ay, az, parameters):
        """Return the velocity of a prediction in space; 0 for a pinned mass."""
        h, keep = parameters.dt, one
        if has_damping:
            keep = kept(parameters.braking, p[3]) if has_load else parameters.keep
        vx, vy, vz = kicked(v[0], keep, h, ax), kicked(v[1], keep, h, ay), kicked(v[2], keep, h, az)
        if has_pins:
            if p[3] == zero:
                vx, vy, vz = zero, zero, zero
        return vx, vy, vz

    @inline
    def rate_of(p, b, parameters):
        inverse = parameters.inverse_substep
        vx, vy, vz = rate(p[0], b[0], inverse), rate(p[1], b[1], inverse), zero
        if solid:
            vz = rate(p[2], b[2], inverse)
        if has_pins:
            if b[3] == zero:
                vx, vy, vz = zero, zero, zero
        return vx, vy, vz

    @inline
    def collide(b, p, vx, vy, vz, world, number):
        if has_pins:
            if b[3] == zero:
                return p[0], p[1], p[2], vx, vy, vz
        return touch(b, p[0], p[1], p[2], vx, vy, vz, world, number)

    @inline
    def settle(b, p, world, number):
        parameters = world.parameters
        vx, vy, vz = rate_of(p, b, parameters)
        return collide(b, p, vx, vy, vz, world, number)

    return SimpleNamespace(predict=predict, kick=kick, rate_of=rate_of, collide=collide, settle=settle)


@cache
def make_tethers(real: Any, math: str) -> Any:
    """Make tether_mass(p, weight, position, anchors, reaches, first, count) -> (x, y, z): the position after the
    long-range attachments of one mass, the nearest first.

    They are numbers `first` ... `first + count - 1` of the flat arrays of anchors (masses) and maximum distances [m].
    Anchors are pinned: any array of positions has them.
    """
    formulas = device_formulas(distance.make, real, math)
    tether, tethered, squared_length = formulas.tether, formulas.tethered, formulas.squared_length_3d
    zero = real(0)

    @inlined(math)
    def tether_mass(p, weight, position, anchors, reaches, first, count):
        x, y, z = p[0], p[1], p[2]
        if weight != zero:
            for n in range(count):
                a = load_quad(position, anchors[first + n])
                dx, dy, dz = x - a[0], y - a[1], z - a[2]
                factor = tether(squared_length(dx, dy, dz), reaches[first + n])
                x, y, z = (
                    tethered(x, a[0], dx, factor), tethered(y, a[1], dy, factor), tethered(z, a[2], dz, factor),
                )  # fmt: skip
        return x, y, z

    return tether_mass
