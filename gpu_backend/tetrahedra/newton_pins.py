"""Pinned particles that move, in Newton's method on CUDA: the position of one of them at a substep's end."""

from __future__ import annotations

from softlab.gpu_backend.contact.pins import follow
from softlab.model.base.variant import inlined_routine
from softlab.model.contact.cloth_parameters import P_MOTION
from softlab.model.formulas.cloth import instant


@inlined_routine
def driven(k, b, pins, world, number):
    """Return (x, y, z, vx, vy, vz) of the pinned particle k at the end of substep `number`: at rest at `b` (a quad), where
    it was, unless it follows a motion."""
    x, y, z, vx, vy, vz = b[0], b[1], b[2], 0.0, 0.0, 0.0
    pin = pins[k]
    if pin > 0:
        if world.colliders[pin + P_MOTION] >= 0.0:
            parameters = world.parameters
            time = instant(number + 1, parameters.dt, parameters.first_step, parameters.first_time)
            x, y, z, vx, vy, vz = follow(world.colliders, pin, time)
    return x, y, z, vx, vy, vz
