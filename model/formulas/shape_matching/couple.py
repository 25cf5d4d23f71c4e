"""Friction between particles acts where they touch: clusters of each get the couple that takes its impulse there.

A contact of particles i and j, at the way r n from j to i, has the impulse p at i and -p at j (particle_contact.py). Both act
at the middles, so a tangential p adds r n x p to the angular momentum. Half way between both they would be on one line: with
the couple c = -(r / 2) n x p for either the pair's momenta add up to zero, and what Coulomb's cone allows stays as it is.

A couple of a particle is split among its clusters as its mass is. A cluster turns by omega = (I + LEAST tr(I))^-1 sum c about
its centre, by omega x r of its split masses: that has no linear momentum, as sum m r = 0, and the angular momentum I omega,
the couple less 3 LEAST of it where a cluster is round. The rest of the couple is lost, all of it about the axis of what is a
line: nothing there could turn. As I stands beside LEAST tr(I), what is nearly a line does not whirl; and nothing turns
farther than FARTHEST in a substep. Positions are moved, before velocities follow from them, to first order in h.

Particles of no cluster and of lattices get no couples: there an impact changes angular momentum by sum |c| at most, half of
mu times the distance times what presses, for each of a pair.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

import numpy as np

from model.formulas import plain
from model.formulas.lengths import make as make_lengths
from model.formulas.shape_matching.pace import make as make_pace

SUMS = 12  # of a cluster: mass times way; couples; m d d' (xx, yy, zz, xy, xz, yz), d from its first particle
FARTHEST = 0.25  # rad: no cluster turns more in a substep by friction, however small it was squashed
SPIN = 6  # numbers of a cluster: its centre, how it turns
LEAST = 2.0**-8  # of the trace of I: a line of small balls of its mass has about that much about itself
OPERATIONS_CONTACT = 24
OPERATIONS_MEMBER = 6 + 6 + 18  # of an entry
OPERATIONS_SPIN = 12 * 15 + 80  # of a cluster
OPERATIONS_TURN = 15  # of an entry


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    zero, one, half, least, farthest = real(0), real(1), real(0.5), real(LEAST), real(FARTHEST)
    huge = real(np.finfo(real).max)
    squared_length_3d = make_lengths(real, compiled).squared_length_3d
    clusters = make_pace(real, compiled)
    less, solved = clusters.less, clusters.solved

    @compiled
    def levered(total, share, length, gripped, a, b, c, d):
        """A sum of couples with that of a contact, one axis: n x s is a b - c d, and p = -share gripped s."""
        return total + share * ((half * length * gripped) * (a * b - c * d))

    @compiled
    def gathered(couple, weight, total):
        """A particle's couple over its mass, with those of a sweep, one axis."""
        return couple + weight * total

    @compiled
    def spin(wx, wy, wz, lx, ly, lz, xx, yy, zz, xy, xz, yz, inverse_mass, px, py, pz):
        """(centre [m], turn [rad]), 3 numbers each, of the sums and the first particle's place."""
        k = inverse_mass
        xx, yy, zz = less(xx, wx, wx, k), less(yy, wy, wy, k), less(zz, wz, wz, k)
        xy, xz, yz = less(xy, wx, wy, k), less(xz, wx, wz, k), less(yz, wy, wz, k)
        more = (least + least) * ((xx + yy) + zz)
        ox, oy, oz = solved((yy + zz) + more, -xy, -xz, (xx + zz) + more, -yz, (xx + yy) + more, lx, ly, lz)
        square, scale = squared_length_3d(ox, oy, oz), one
        if square > farthest * farthest:
            scale = farthest / sqrt(square)
        if not square <= huge:  # of a point
            ox, oy, oz = zero, zero, zero
        return px + wx * k, py + wy * k, pz + wz * k, scale * ox, scale * oy, scale * oz

    @compiled
    def turned(total, share, a, b, c, d):
        """The ways of a particle with that of a cluster's turn, one axis."""
        return total + share * (a * b - c * d)

    @compiled
    def gone(position, way):
        """A particle after that; where nothing turned it, to the bits what it was."""
        return position + way if way != zero else position

    return SimpleNamespace(levered=levered, gathered=gathered, spin=spin, turned=turned, gone=gone)
