"""Position and velocity of a pinned mass that follows a motion, compiled by both backends."""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import inlined_routine
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
)  # fmt: skip
from softlab.model.formulas.motion import placed, turn


@inlined_routine
def follow(bodies, pin, time):
    """Return (x, y, z, vx, vy, vz), the state at `time` [s] of the mass whose row begins at `pin`.

    `bodies`: the flat array `body_rows` of model/contact/cloth_parameters.py. The row must name a motion.
    """
    row = np.int32(bodies[pin + P_MOTION])
    moment = turn(time, bodies[row + M_START], bodies[row + M_DURATION], bodies[row + M_TURNS])
    return placed(
        (bodies[pin + P_X], bodies[pin + P_Y], bodies[pin + P_Z]),
        (bodies[row + M_X], bodies[row + M_Y], bodies[row + M_Z]),
        (bodies[row + M_U], bodies[row + M_V], bodies[row + M_W]),
        (bodies[row + M_VX], bodies[row + M_VY], bodies[row + M_VZ]), bodies[row + M_SPIN], moment,
    )  # fmt: skip
