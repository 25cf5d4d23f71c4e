"""Damping of the motion inside a cluster: velocities tend to the rigid motion that has the cluster's momenta.

M. Mueller et al., "Position Based Dynamics", J. Vis. Commun. Image R. 18, 2007, 3.5: with r = x - c, L = sum m r x v
and I = sum m (r.r - r r'), the spin is omega = I^-1 L and v += k (v_c + omega x r - v). Linear momentum is conserved,
as sum m r = 0 and sum m v = M v_c; angular momentum too, as sum m r x (omega x r) = I omega = L: for any k, if a
cluster sums and moves the same split masses. A particle of several clusters gets the sum of their changes, each with a
factor share (1 - exp(-d h)).

Sums are over d = x - x' and u = v - v' relative to the cluster's first particle and have the order of cluster.py. Those
about the centre follow, as sum m r x u = sum m d x u - (sum m d) x (sum m u) / M.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import OfPrecision, formula

MOMENTA = 15  # of a cluster: mass times position and velocity, by axis; d x (m u); m d d' (xx, yy, zz, xy, xz, yz)
MOTION = 9  # numbers of a cluster's motion: its centre, the velocity there, its spin
OPERATIONS_MEMBER = 6 + 6 + 15 + 18  # of an entry
OPERATIONS_MOTION = 15 * 15 + 90  # of a cluster
OPERATIONS_SLOWED = 30  # of an entry
LEAST = 1024  # eps: the smallest pivot of I over its trace, so that rounding rotates nothing that lies along a line

TINY = OfPrecision(lambda real: 4 * np.finfo(real).tiny)
LEAST_PIVOT = OfPrecision(lambda real: LEAST * float(np.finfo(real).eps))


@formula
def weighted(mass, value, first):
    """Mass times a difference from the first particle, one axis."""
    return mass * (value - first)


@formula
def cross_added(total, a, b, c, d):
    """Sum plus a component of a cross product."""
    return total + (a * b - c * d)


@formula
def added(total, weight, other):
    return total + weight * other


@formula
def less(moment, a, b, inverse_mass):
    """Second moment about the centre instead of the first particle."""
    return moment - (a * b) * inverse_mass


@formula
def crossed(moment, a, b, c, d, inverse_mass):
    return moment - (a * b - c * d) * inverse_mass


@formula
def solved(xx, xy, xz, yy, yz, zz, x, y, z):
    """I^-1 L by Cholesky's decomposition, with pivots no less than LEAST of the trace: along a line, about which
    nothing can spin, 0."""
    floor = max(LEAST_PIVOT * ((xx + yy) + zz), TINY)
    first = max(xx, floor)
    lower_y, lower_z = xy / first, xz / first
    second = max(yy - lower_y * xy, floor)
    rest = yz - lower_y * xz
    lower = rest / second
    third = max((zz - lower_z * xz) - lower * rest, floor)
    middle = y - lower_y * x
    oz = ((z - lower_z * x) - lower * middle) / third
    oy = middle / second - lower * oz
    return (x / first - lower_y * oy) - lower_z * oz, oy, oz


@formula
def motion(w, u, momentum, moments, inverse_mass, position, velocity):
    """Return (centre [m], velocity [m/s], spin [rad/s]), 3 numbers each, from the sums (mass times position and
    velocity, angular momentum, second moments) and the first particle's position and velocity."""
    wx, wy, wz = w
    ux, uy, uz = u
    lx, ly, lz = momentum
    xx, yy, zz, xy, xz, yz = moments
    px, py, pz = position
    vx, vy, vz = velocity
    k = inverse_mass
    xx, yy, zz = less(xx, wx, wx, k), less(yy, wy, wy, k), less(zz, wz, wz, k)
    xy, xz, yz = less(xy, wx, wy, k), less(xz, wx, wz, k), less(yz, wy, wz, k)
    ox, oy, oz = solved(
        yy + zz, -xy, -xz, xx + zz, -yz, xx + yy, crossed(lx, wy, uz, wz, uy, k), crossed(ly, wz, ux, wx, uz, k),
        crossed(lz, wx, uy, wy, ux, k),
    )  # fmt: skip
    return px + wx * k, py + wy * k, pz + wz * k, vx + ux * k, vy + uy * k, vz + uz * k, ox, oy, oz


@formula
def slowed(total, factor, centre_velocity, a, b, c, d, velocity):
    """Sum of velocity changes [m/s] of a particle towards its clusters' motions, one axis.

    The rigid motion is `centre_velocity` + (a b - c d), the cross product of spin and position.
    """
    return total + factor * ((centre_velocity + (a * b - c * d)) - velocity)
