"""Particles whose pins follow a motion, for the CPU's kernels. The motion of one: model/contact/pins.py."""

from __future__ import annotations

from softlab.model.base.variant import routine
from softlab.model.contact.cloth_parameters import P_MOTION, PIN_FIELDS
from softlab.model.contact.pins import follow as follow
from softlab.model.formulas.cloth import instant


@routine
def drive(first, last, number, position, velocity, parameters, bodies, driven):
    """Set position and velocity of pinned particles at the end of substep `number` by their motions: of `driven`
    (pins,), all pinned particles, `first` to before `last`.

    Their rows are the last of `bodies`; those without a motion are unchanged.
    """
    time = instant(number + 1, parameters.dt, parameters.first_step, parameters.first_time)
    begin = bodies.size - PIN_FIELDS * driven.size
    for n in range(first, last):
        k, pin = driven[n], begin + PIN_FIELDS * n
        if bodies[pin + P_MOTION] >= 0:
            x, y, z, vx, vy, vz = follow(bodies, pin, time)
            position[k, 0], position[k, 1], position[k, 2] = x, y, z
            velocity[k, 0], velocity[k, 1], velocity[k, 2] = vx, vy, vz
