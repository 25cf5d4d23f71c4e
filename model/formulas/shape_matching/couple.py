"""Friction between particles acts where they touch: the clusters of each get the couple that moves its impulse there.

A contact of particles i and j, with the vector r n from j to i, has the impulse p at i and -p at j
(particle_contact.py). Both act at the centres, so a tangential p adds r n x p to the angular momentum. Half way between
both they would act on one line: with the couple c = -(r / 2) n x p for each, the pair's momenta sum to zero, and
Coulomb's cone is unchanged.

A couple of a particle is split among its clusters as its mass is. A cluster turns by omega = (I + LEAST tr(I))^-1 sum c
about its centre, by omega x r of its split masses. That has no linear momentum, as sum m r = 0, and the angular
momentum I omega, which is the couple less 3 LEAST of it where a cluster is round. The rest of the couple is lost; about
the axis of a line all of it is lost, since nothing there could rotate. As I is combined with LEAST tr(I), near-lines do
not spin fast, and nothing turns farther than FARTHEST in a substep. Positions are moved, before velocities follow from
them, to first order in h.

Particles without a cluster get no couples: there an impact changes angular momentum by at most sum |c|, half of mu
times the distance times the normal impulse, for each of a pair. The windows of a lattice are clusters like others here.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import OfPrecision, formula
from softlab.model.formulas.lengths import squared_length_3d
from softlab.model.formulas.shape_matching.pace import less, solved

SUMS = 12  # of a cluster: mass times position; couples; m d d' (xx, yy, zz, xy, xz, yz), d from its first particle
FARTHEST = 0.25  # rad: largest turn of a cluster by friction in a substep, however small it was squashed
SPIN = 6  # numbers of a cluster: its centre, its turn
LEAST = 2.0**-8  # of the trace of I: a line of small balls of its mass has about that moment of inertia about itself
OPERATIONS_CONTACT = 24
OPERATIONS_MEMBER = 6 + 6 + 18  # of an entry
OPERATIONS_SPIN = 12 * 15 + 80  # of a cluster
OPERATIONS_TURN = 15  # of an entry

HUGE = OfPrecision(lambda real: np.finfo(real).max)


@formula
def levered(total, fraction, length, gripped, a, b, c, d):
    """Sum of couples plus that of a contact, one axis: n x s is a b - c d, and p = -fraction gripped s."""
    return total + fraction * ((0.5 * length * gripped) * (a * b - c * d))


@formula
def gathered(couple, weight, total):
    """Couple of a particle over its mass plus those of a sweep, one axis."""
    return couple + weight * total


@formula
def spin(w, couple, moments, inverse_mass, position):
    """Return (centre [m], turn [rad]), 3 numbers each, from the sums (mass times position, couple, second moments) and
    the first particle's position."""
    wx, wy, wz = w
    xx, yy, zz, xy, xz, yz = moments
    k = inverse_mass
    xx, yy, zz = less(xx, wx, wx, k), less(yy, wy, wy, k), less(zz, wz, wz, k)
    xy, xz, yz = less(xy, wx, wy, k), less(xz, wx, wz, k), less(yz, wy, wz, k)
    more = (LEAST + LEAST) * ((xx + yy) + zz)
    ox, oy, oz = solved(
        (yy + zz) + more, -xy, -xz, (xx + zz) + more, -yz, (xx + yy) + more, couple[0], couple[1], couple[2]
    )
    square, scale = squared_length_3d(ox, oy, oz), 1.0
    if square > FARTHEST * FARTHEST:
        scale = FARTHEST / sqrt(square)
    if not square <= HUGE:  # a cluster of one point
        ox, oy, oz = 0.0, 0.0, 0.0
    return position[0] + wx * k, position[1] + wy * k, position[2] + wz * k, scale * ox, scale * oy, scale * oz


@formula
def cross_added(total, fraction, a, b, c, d):
    """Sum of a particle's displacements plus that of a cluster's turn, one axis."""
    return total + fraction * (a * b - c * d)


@formula
def gone(position, displacement):
    """Position after the displacement; the same bits where that is 0."""
    return position + displacement if displacement != 0.0 else position
