"""Shape matching of clusters in space: a particle's contribution to a cluster's moments, and its goal position.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, eq. 7 to 9. Positions are relative to
the cluster's first particle, so that float32 loses nothing far from the origin, and one pass over the particles is
enough. With d these relative positions, r rest offsets, and the `lean` r' = sum m r / sum m, the rounding error of a
centre at 0,
  A = sum m (d - d') (r - r')^T = sum m d r^T - (sum m d) r'^T,   goal = centre + R (r - r').
Without the `lean` a body would be moved and rotated a little in every substep, always in the same direction.

Sums have one order on all machines: entry n of a cluster is added to lane n % LANES, in the order of the entries, and
the lanes are then added in pairs, half of them apart (`total`).
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.rotation import OPERATIONS_MATRIX, OPERATIONS_NEAR

LANES = 16
MOMENTS = 12  # of a cluster: the sum of mass times relative position, by axis; that times the rest offset, by rows
OPERATIONS_MEMBER = 27  # of an entry: 3 differences, 12 products and 12 sums
OPERATIONS_TURN = OPERATIONS_NEAR[4] + OPERATIONS_MATRIX + MOMENTS * (LANES - 1) + 18 + 24  # of a cluster
OPERATIONS_GOAL = 27  # of an entry: 18 for the goal, 9
OPERATIONS_MOVE = 3  # of a particle


@formula
def weighted(mass, position, first):
    """Mass times the position relative to the cluster's first particle [kg m], one axis."""
    return mass * (position - first)


@formula
def added(total, position, rest):
    """Moment plus that of one more entry: its weighted position along an axis times its rest offset along
    another."""
    return total + position * rest


@formula
def total(lanes):
    """Sum of LANES lanes."""
    a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p = lanes  # noqa: E741
    return (((a + i) + (e + m)) + ((c + k) + (g + o))) + (((b + j) + (f + n)) + ((d + l) + (h + p)))


@formula
def corrected(moment, position_sum, rest_offset):
    """Entry of A: along a current axis and one at rest."""
    return moment - position_sum * rest_offset


@formula
def centre(first, position_sum, inverse_mass, a, b, c, x, y, z):
    """Image of a rest offset of 0 [m], one axis, by a row of R: the centre of mass, corrected for the rest
    offset (x, y, z)."""
    return first + (position_sum * inverse_mass - ((a * x + b * y) + c * z))


@formula
def goal(centre, a, b, c, x, y, z):
    """Goal position of an entry [m], one axis, by a row of R and the rest offset."""
    return centre + ((a * x + b * y) + c * z)


@formula
def displacement_added(displacement, factor, goal, position):
    """Sum of displacements [m] of a particle to its goals, one axis.

    `factor`: the entry's weight in its particle times the fraction by which the cluster moves particles in an
    iteration.
    """
    return displacement + factor * (goal - position)


@formula
def arrived(position, displacement):
    return position + displacement
