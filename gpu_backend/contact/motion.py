"""Operations of a substep on one particle, as device functions: its prediction, and its velocity afterwards.

Particles are quads: x, y, z and the weight w, 0 if pinned, 1, or the sheet's mass over the mass's own if the scene has a
`load`. In a plane z stays 0 and is not computed."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.model.base.types import Real
from softlab.model.formulas import distance


@cache
def make_motion(real: Real, math: str, parts: frozenset[str], axes: int) -> SimpleNamespace:
    """Make `predict`, `kick`, `rate_of`, `collide` and `settle`.

    `predict(p, v, ax, ay, az, parameters)` -> (x, y, z): the position without constraints; `kick(p, v, ax, ay, az,
    parameters)` -> the velocity of the prediction; `rate_of(p, b, parameters)` -> the velocity from b to p (quads);
    `collide(b, p, vx, vy, vz, world, number)` -> (x, y, z, vx, vy, vz): after the colliders, in substep `number`;
    `settle`: the last two, from the substep's start and end.
    """
    formulas = device_formulas(distance, real, math)
    kicked, damping_factor, predicted, rate = (
        formulas.kicked,
        formulas.damping_factor,
        formulas.predicted,
        formulas.rate,
    )
    touch = make_collide(real, math, parts)
    inline = inlined(math)
    has_pins, has_load, has_damping, solid = "pins" in parts, "load" in parts, "damping" in parts, axes == 3
    zero, one = real(0), real(1)

    @inline
    def predict(p, v, ax, ay, az, parameters):
        h, keep = parameters.dt, one
        if has_damping:
            keep = damping_factor(parameters.braking, p[3]) if has_load else parameters.keep
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
            keep = damping_factor(parameters.braking, p[3]) if has_load else parameters.keep
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
