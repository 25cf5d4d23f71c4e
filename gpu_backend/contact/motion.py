"""Operations of a substep on one particle, as device functions: its prediction, and its velocity afterwards.

Particles are quads: x, y, z and the weight w, 0 if pinned, 1, or the sheet's mass over the mass's own if the scene has a
`load`. In a plane z stays 0 and is not computed."""

from __future__ import annotations

from softlab.gpu_backend.contact.colliders import collide as collide_all
from softlab.model.base.variant import FEATURE, inlined_routine
from softlab.model.formulas.distance import damping_factor, kicked, predicted, rate


@inlined_routine
def factor_of(weight, parameters):
    """Return the factor by which damping shrinks a velocity."""
    if FEATURE.damping:
        return damping_factor(parameters.braking, weight) if FEATURE.load else parameters.keep
    return 1.0


@inlined_routine
def predict(p, v, ax, ay, az, parameters):
    """Return (x, y, z), the position without constraints."""
    h, factor = parameters.dt, factor_of(p[3], parameters)
    x = predicted(p[0], h, kicked(v[0], factor, h, ax))
    y = predicted(p[1], h, kicked(v[1], factor, h, ay))
    z = p[2]
    if FEATURE.axes == 3:
        z = predicted(z, h, kicked(v[2], factor, h, az))
    if FEATURE.pins:
        if p[3] == 0.0:
            x, y, z = p[0], p[1], p[2]
    return x, y, z


@inlined_routine
def kick(p, v, ax, ay, az, parameters):
    """Return the velocity of a prediction in space; 0 for a pinned mass."""
    h, factor = parameters.dt, factor_of(p[3], parameters)
    vx, vy, vz = kicked(v[0], factor, h, ax), kicked(v[1], factor, h, ay), kicked(v[2], factor, h, az)
    if FEATURE.pins:
        if p[3] == 0.0:
            vx, vy, vz = 0.0, 0.0, 0.0
    return vx, vy, vz


@inlined_routine
def rate_of(p, b, parameters):
    """Return the velocity from b to p (quads)."""
    inverse = parameters.inverse_substep
    vx, vy, vz = rate(p[0], b[0], inverse), rate(p[1], b[1], inverse), 0.0
    if FEATURE.axes == 3:
        vz = rate(p[2], b[2], inverse)
    if FEATURE.pins:
        if b[3] == 0.0:
            vx, vy, vz = 0.0, 0.0, 0.0
    return vx, vy, vz


@inlined_routine
def collide(b, p, vx, vy, vz, world, number):
    """Return (x, y, z, vx, vy, vz), the state after the colliders in substep `number`."""
    if FEATURE.pins:
        if b[3] == 0.0:
            return p[0], p[1], p[2], vx, vy, vz
    return collide_all(b, p[0], p[1], p[2], vx, vy, vz, world, number)


@inlined_routine
def settle(b, p, world, number):
    """Return (x, y, z, vx, vy, vz) after the colliders, from the substep's start b and end p."""
    vx, vy, vz = rate_of(p, b, world.parameters)
    return collide(b, p, vx, vy, vz, world, number)
