"""Shape matching on a grid: a mass's contribution to the sums of a cluster, and the clusters' effect on a mass.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, eq. 7 to 9. A cluster around every
mass of a lattice contains the masses at most a half-width away along each axis: A. Rivers, D. James, "FastLSM: Fast
Lattice Shape Matching for Robust Real-Time Deformation", SIGGRAPH 2007. As there, sums over a window are sums over its
rows of sums along a row. All windows that contain the row share its sums, so that the cost grows with the half-width
and not with its square. A row's sums use positions relative to the mass (the cluster) in the window's column, begin
with that one, then go from left to right; a window's rows are relative to the mass in its middle. So float32 loses
nothing far from the origin. Weights of masses, rest offsets and masses of windows are products of a row's and a
column's, since windows are cut off by straight edges.
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.rotation import OPERATIONS_2D, rotation_2d

OPERATIONS_MEMBER = 11  # a member of a window's row, besides the mass itself
OPERATIONS_ROW = 18  # of a window
OPERATIONS_CLUSTER = OPERATIONS_2D + 5  # centre and rotation
OPERATIONS_GOAL_MEMBER = 16
OPERATIONS_GOAL_ROW = 16
OPERATIONS_MOVE = 8


@formula
def added_member(sums, x, y, middle_x, middle_y, weight, step, centre):
    """Sums along a row plus those of one more mass at (x, y): its weighted difference from the mass in the window's
    column, at the `middle` [m], and that times its rest offset, `step` minus the window's `centre` [spacings]."""
    part_x, part_y = weight * (x - middle_x), weight * (y - middle_y)
    offset = step - centre
    return sums[0] + part_x, sums[1] + part_y, sums[2] + part_x * offset, sums[3] + part_y * offset


@formula
def added_row(sums, line, middle_x, middle_y, here_x, here_y, mass, weight, offset):
    """Sums of a window plus those of one more row.

    Returns 2 of differences, 2 of those times the offset along the rows, 2 of those times the row's `offset` below
    the centre. `line`: the row's sums, relative to `middle`; the result is relative to `here`. `mass`: the sum of the
    row's weights. Rest offsets along the row times weights sum to 0, so that the rotational sums do not depend on
    the reference.
    """
    sum_x, sum_y, turn_x, turn_y = line
    part_x, part_y = weight * (sum_x + mass * (middle_x - here_x)), weight * (sum_y + mass * (middle_y - here_y))
    return (
        sums[0] + part_x, sums[1] + part_y, sums[2] + weight * turn_x, sums[3] + weight * turn_y,
        sums[4] + part_x * offset, sums[5] + part_y * offset,
    )  # fmt: skip


@formula
def cluster(sums, here_x, here_y, inverse_row, inverse_column):
    """Return (centre [m], cosine, sine) of a cluster from its sums.

    Its rotation is the one nearest to sum m (x - centre) rest'. Rest offsets are relative to the rest centre, so
    that the centre drops out. Rows count against y. The inverse of its mass is the product of a row's and a
    column's.
    """
    cosine, sine = rotation_2d(sums[2], -sums[4], sums[3], -sums[5], 1.0, 0.0)
    inverse = inverse_row * inverse_column
    return here_x + sums[0] * inverse, here_y + sums[1] * inverse, cosine, sine


@formula
def rest_offset(step, centre, rest):
    """Rest position of a mass relative to a cluster's centre along one axis [m].

    The mass is `step` spacings of `rest` [m] from the middle of the window, whose centre of mass is `centre` spacings
    from that.
    """
    return (step - centre) * rest


@formula
def added_goal(sums, centre_x, centre_y, middle_x, middle_y, cosine, sine, along):
    """Sums along a row of clusters plus those of one more: 2 of centres relative to the middle one [m], 2 of the
    rotated `along` [m], of cosines, of sines. `along`: rest position of the mass relative to its centre, x [m]."""
    return (
        sums[0] + (centre_x - middle_x), sums[1] + (centre_y - middle_y), sums[2] + cosine * along,
        sums[3] + sine * along, sums[4] + cosine, sums[5] + sine,
    )  # fmt: skip


@formula
def added_goal_row(total_x, total_y, sums, x, y, middle_x, middle_y, count, down):
    """Sum of displacements from the mass at (x, y) to its goals plus those of a row of `count` clusters, whose sums
    are relative to `middle`.

    `down`: rest position of the mass below their centres [m]. A rotation takes (along, -down) to (cosine along +
    sine down, sine along - cosine down).
    """
    row_x = (sums[0] + count * (middle_x - x)) + (sums[2] + sums[5] * down)
    row_y = (sums[1] + count * (middle_y - y)) + (sums[3] - sums[4] * down)
    return total_x + row_x, total_y + row_y


@formula
def moved(position, row_weight, column_weight, matching, displacement):
    """Position [m], one axis, after the fraction `matching` of the mean displacement. The mass's weight in each of
    its clusters is a product."""
    return position + row_weight * column_weight * matching * displacement
