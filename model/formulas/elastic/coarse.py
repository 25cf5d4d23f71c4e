"""Coarse level of a two-level preconditioner: groups of particles that move as rigid bodies, by t + w x d s.

d is a particle's offset from its group's centre and s one over the root mean square of their lengths, so that all six
unknowns are lengths. With P these motions and A the matrix, P'AP is factored and P (P'AP)^-1 P' is added to the inverse
of A's diagonal blocks: errors that converge slowly with these alone are close to rigid motions (P. Vanek, J. Mandel, M.
Brezina, "Algebraic Multigrid by Smoothed Aggregation for Second and Fourth Order Elliptic Problems", Computing 56
(1996), without their smoothing; additive as in M. Dryja, O. Widlund, 1987).
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula
from softlab.model.formulas.lengths import cross

LOST = 64  # rounding units: a pivot below so many times its row's entry is rounding, and its motion is omitted

LEAST_PIVOT = OfPrecision(lambda real: LOST * float(np.finfo(real).eps))


@formula
def scale_of(squares, count):
    """Scale s, from the sum of squares of d."""
    return sqrt(count / squares) if squares > 0.0 else 0.0


@formula
def arm(x, y, z, cx, cy, cz, s):
    """d s, three numbers."""
    return s * (x - cx), s * (y - cy), s * (z - cz)


@formula
def moment(d, x, y, z):
    """P' of a vector at a particle: (force, moment)."""
    p, q, r = cross(d[0], d[1], d[2], x, y, z)
    return x, y, z, p, q, r


@formula
def motion(d, y):
    """P y at a particle."""
    p, q, r = cross(y[3], y[4], y[5], d[0], d[1], d[2])
    return y[0] + p, y[1] + q, y[2] + r


@formula
def columns(d, e, m):
    """P' M P, six columns of six numbers, of a block M (9, by rows) from a particle with the arm `e` to one with
    `d`."""
    px, py, pz = cross(e[0], e[1], e[2], m[0], m[1], m[2])
    qx, qy, qz = cross(e[0], e[1], e[2], m[3], m[4], m[5])
    rx, ry, rz = cross(e[0], e[1], e[2], m[6], m[7], m[8])
    return (
        moment(d, m[0], m[3], m[6]), moment(d, m[1], m[4], m[7]), moment(d, m[2], m[5], m[8]), moment(d, px, qx, rx),
        moment(d, py, qy, ry), moment(d, pz, qz, rz),
    )  # fmt: skip


@formula
def pivot(left, entry):
    """Return (1 / root of the remaining diagonal entry, or 0 if it is rounding error; True if it is negative)."""
    least = LEAST_PIVOT * entry
    return (1.0 / sqrt(left) if left > least else 0.0), left < -least
