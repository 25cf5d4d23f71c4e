"""Pins that follow a path: a rotation about an axis and a translation, at constant speeds for a while.

Sine and cosine are written out here, since those of two libraries differ in the last bit, and `exact` math must give
the same bits on every processor.
"""

from __future__ import annotations

from math import factorial, floor, pi

import numpy as np

from softlab.model.base.variant import formula, real

# Taylor's terms up to x^16 / 16! and x^17 / 17! on |x| <= pi/4: the truncation error is below 3e-18 of the value.
SINE_TERMS = tuple((-1) ** k / factorial(2 * k + 1) for k in range(1, 9))
COSINE_TERMS = tuple((-1) ** k / factorial(2 * k) for k in range(1, 9))

WHOLE_TURN = 2 * pi


@formula
def sine_cosine(turns):
    """Return (sine, cosine) of 2 pi `turns`, |turns| < 2^60.

    The nearest quarter turn is subtracted first, without rounding. With u half a unit in the last place of 1, the
    error of the remainder x = 2 pi f is 2u x; the sine's sum adds 1.4u of the value and the cosine's 1.5u. Both are
    accurate within 4u.
    """
    s3, s5, s7, s9, s11, s13, s15, s17 = SINE_TERMS
    c2, c4, c6, c8, c10, c12, c14, c16 = COSINE_TERMS
    quarters = floor(4.0 * turns + 0.5)
    x = WHOLE_TURN * (turns - 0.25 * real(quarters))
    q = x * x
    high = s9 + q * (s11 + q * (s13 + q * (s15 + q * s17)))
    sine = x + x * (q * (s3 + q * (s5 + q * (s7 + q * high))))
    high = c8 + q * (c10 + q * (c12 + q * (c14 + q * c16)))
    cosine = 1.0 + q * (c2 + q * (c4 + q * (c6 + q * high)))
    side = np.int64(quarters) & 3
    if side == 1:
        return cosine, -sine
    if side == 2:
        return -sine, -cosine
    if side == 3:
        return -cosine, sine
    return sine, cosine


@formula
def turn(time, start, duration, rate):
    """State of a motion at `time` [s]: (seconds passed in it, True if it moves, sine and cosine of its angle).

    `rate`: turns per second. It moves at its start and rests at its end.
    """
    since = time - start
    passed = min(max(since, 0.0), duration)
    sine, cosine = sine_cosine(rate * passed)
    return passed, since >= 0.0 and since < duration, sine, cosine


@formula
def placed(rest, centre, axis, velocity, spin, moment):
    """Position [m] and velocity [m/s] (px, py, pz, qx, qy, qz) of a mass from its rest position.

    `axis`: the unit axis u; `spin`: rad/s; `moment`: from `turn`. O. Rodrigues' rotation, a' = a + sin t + (1 -
    cos) n with t = u x a and n = u x t. Before the start it is exactly the mass's rest position.
    """
    x, y, z = rest
    ux, uy, uz = axis
    vx, vy, vz = velocity
    passed, moves, sine, cosine = moment
    ax, ay, az = x - centre[0], y - centre[1], z - centre[2]
    tx, ty, tz = uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax
    nx, ny, nz = uy * tz - uz * ty, uz * tx - ux * tz, ux * ty - uy * tx
    lifted = 1.0 - cosine
    px = x + ((sine * tx + lifted * nx) + passed * vx)
    py = y + ((sine * ty + lifted * ny) + passed * vy)
    pz = z + ((sine * tz + lifted * nz) + passed * vz)
    if not moves:
        return px, py, pz, 0.0, 0.0, 0.0
    qx = vx + spin * (cosine * tx + sine * nx)
    qy = vy + spin * (cosine * ty + sine * ny)
    qz = vz + spin * (cosine * tz + sine * nz)
    return px, py, pz, qx, qy, qz


@formula
def middle(step, dt, first_step, first_time):
    """Time [s] half-way through step number `step`. Step number `first_step` begins at `first_time` [s]."""
    return first_time + ((real(step) - first_step) + 0.5) * dt
