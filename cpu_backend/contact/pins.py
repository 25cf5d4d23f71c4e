"""Positions of a cloth's pinned masses that follow a motion, for the CPU's kernels, one mass at a time."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import routine
from softlab.model.contact.cloth_parameters import (
    M_DURATION,
    M_SPIN,
    M_START,
    M_TURNS,
    M_U,
    M_V,
    M_VX,
    M_VY,
    M_VZ,
    M_W,
    M_X,
    M_Y,
    M_Z,
    P_MOTION,
    P_X,
    P_Y,
    P_Z,
    PIN_FIELDS,
)  # fmt: skip
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.motion import placed, turn


@routine
def follow(bodies, pin, time):
    """Return (x, y, z, vx, vy, vz), the state of a pinned mass at `time` [s].

    Its row begins at `pin` of the flat array `body_rows` of model/contact/cloth_parameters.py, and must name a
    motion.
    """
    row = np.int64(bodies[pin + P_MOTION])
    moment = turn(time, bodies[row + M_START], bodies[row + M_DURATION], bodies[row + M_TURNS])
    return placed(
        (bodies[pin + P_X], bodies[pin + P_Y], bodies[pin + P_Z]),
        (bodies[row + M_X], bodies[row + M_Y], bodies[row + M_Z]),
        (bodies[row + M_U], bodies[row + M_V], bodies[row + M_W]),
        (bodies[row + M_VX], bodies[row + M_VY], bodies[row + M_VZ]), bodies[row + M_SPIN], moment,
    )  # fmt: skip


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
