"""Wind on a triangle: a flat plate's drag and lift, from its velocity relative to the air; and gusts.

The coefficients of a flat plate at the angle a between its plane and the stream: drag ~ sin a, lift ~ sin a cos a, as
in M. Keckeisen, S. Kimmerle, B. Thomaszewski and M. Wacker, "Modelling effects of wind fields in cloth animations",
Journal of WSCG 12 (2004), section 4.1, each times half the air's density, the area, and the squared speed.
"""

from __future__ import annotations

from math import floor

import numpy as np

from softlab.model.base.variant import formula, real
from softlab.model.formulas.cloth import mean
from softlab.model.formulas.lengths import inverse_length, squared_length_3d
from softlab.model.formulas.random import uniform

OPERATIONS_TRIANGLE = 62
GUST_STREAM = 0  # particle number under which the random generator draws gusts


@formula
def triangle_wind(ab, ac, u, drag, lift):
    """Force over mass [m/s^2] on each corner of the triangle with the edges ab and ac [m], in a relative wind u
    [m/s].

    `drag`, `lift` [1/m^2]: density / 2 * coefficient / mass / 6, since a corner takes a third, and the length of n
    = ab x ac is twice the area. The sum of drag |u.n| u and lift (u.n) (|u| n / |n| - (u.n) u / (|u| |n|)), neither
    of which depends on the side that n points to. Zero for a triangle without area and for still air.
    """
    ux, uy, uz = u
    nx = ab[1] * ac[2] - ab[2] * ac[1]
    ny = ab[2] * ac[0] - ab[0] * ac[2]
    nz = ab[0] * ac[1] - ab[1] * ac[0]
    through = (ux * nx + uy * ny) + uz * nz
    squared = squared_length_3d(ux, uy, uz)
    inverse_speed = inverse_length(squared)
    inverse_normal = inverse_length(squared_length_3d(nx, ny, nz))
    along_normal = lift * through * (squared * inverse_speed) * inverse_normal
    along_air = drag * abs(through) - lift * through * through * inverse_speed * inverse_normal
    return (
        along_normal * nx + along_air * ux, along_normal * ny + along_air * uy, along_normal * nz + along_air * uz,
    )  # fmt: skip


@formula
def wind_on_triangle(a, b, c, va, vb, vc, air, drag, lift):
    """Return the wind acceleration [m/s^2] of each corner, by the positions and velocities of all."""
    return triangle_wind(
        (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]),
        (air[0] - mean(va[0], vb[0], vc[0]), air[1] - mean(va[1], vb[1], vc[1]), air[2] - mean(va[2], vb[2], vc[2])),
        drag, lift,
    )  # fmt: skip


@formula
def stage_time(step, offset, dt, first_step, first_time):
    """Time [s] of a stage `offset` steps into step number `step`. Step number `first_step` begins at `first_time`
    [s]."""
    return first_time + ((real(step) - first_step) * dt + offset * dt)


@formula
def gust_interval(time, gust_time):
    """Return (number of the interval that contains `time` [s], fraction of it that has passed, in [0, 1))."""
    intervals = time / gust_time
    whole = floor(intervals)
    return np.int64(whole), intervals - real(whole)


@formula
def gust(word_before, word_after, part):
    """g in (-1, 1): interpolated from one interval's random word to the next one's along 3 p^2 - 2 p^3."""
    before, after = uniform(word_before), uniform(word_after)
    smooth = part * part * (3.0 - 2.0 * part)
    return before + smooth * (after - before)
