"""Shape matching on a lattice: what a mass adds to the sums of a cluster, and what the clusters make of a mass.

M. Mueller et al., "Meshless Deformations Based on Shape Matching", SIGGRAPH 2005, eq. 7 to 9; a cluster around every mass of
a lattice, of the masses at most a half-width away along each axis: A. Rivers, D. James, "FastLSM: Fast Lattice Shape Matching
for Robust Real-Time Deformation", SIGGRAPH 2007. As there, sums over a window are sums over its rows of sums along a row,
which all windows that share the row share, so that the cost grows with the half-width and not with its square. A row's sums
count positions from the mass (the cluster) in the window's column, and begin with that one, then from left to right; a
window's rows from the mass in its middle: so float32 loses nothing far from the origin. Shares of masses, rest offsets and
masses of windows are products of a row's and a column's, since windows are cut off by straight edges.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.rotation import OPERATIONS_2D, make_2d

OPERATIONS_MEMBER = 11  # of a window's row, beside the mass itself
OPERATIONS_ROW = 18  # of a window
OPERATIONS_CLUSTER = OPERATIONS_2D + 5  # centre and rotation
OPERATIONS_GOAL_MEMBER = 16
OPERATIONS_GOAL_ROW = 16
OPERATIONS_MOVE = 8


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`. x: along a row of the lattice; y: against its columns' direction."""
    rotation_2d = make_2d(real, compiled)
    one, zero = real(1), real(0)

    @compiled
    def added_member(sum_x, sum_y, turn_x, turn_y, x, y, middle_x, middle_y, share, step, centre):
        """The sums along a row with one more mass, at (x, y), the one in the window's column at the middle [m]: of the
        difference times its share, and of that times its rest offset, `step` less the window's `centre` [spacings]."""
        part_x, part_y = share * (x - middle_x), share * (y - middle_y)
        offset = step - centre
        return sum_x + part_x, sum_y + part_y, turn_x + part_x * offset, turn_y + part_y * offset

    @compiled
    def added_row(sums, sum_x, sum_y, turn_x, turn_y, middle_x, middle_y, here_x, here_y, mass, share, offset):
        """The sums of a window with one more row of it, whose sums count from `middle`, to be counted from `here`: (2 of
        differences, 2 of those times the offset along the rows, 2 of those times the row's `offset` below the centre).
        `mass`: the row's shares together. Rest offsets along it times shares add up to 0, so that the turn stays as it is."""
        part_x, part_y = share * (sum_x + mass * (middle_x - here_x)), share * (sum_y + mass * (middle_y - here_y))
        return (
            sums[0] + part_x, sums[1] + part_y, sums[2] + share * turn_x, sums[3] + share * turn_y,
            sums[4] + part_x * offset, sums[5] + part_y * offset,
        )  # fmt: skip

    @compiled
    def cluster(sums, here_x, here_y, inverse_row, inverse_column):
        """(centre [m], cosine, sine) of a cluster from its sums: its turn is the rotation nearest to sum m (x - centre)
        rest', where rest offsets are counted from the rest centre, so that the centre drops out. Rows count against y. The
        inverse of its mass is the product of a row's and a column's."""
        cosine, sine = rotation_2d(sums[2], -sums[4], sums[3], -sums[5], one, zero)
        inverse = inverse_row * inverse_column
        return here_x + sums[0] * inverse, here_y + sums[1] * inverse, cosine, sine

    @compiled
    def rest_offset(step, centre, rest):
        """Where a mass lies at rest from the centre of a cluster along one axis [m]: `step` spacings of `rest` [m] from the
        window's middle, whose centre lies `centre` spacings from that."""
        return (step - centre) * rest

    @compiled
    def added_goal(sums, centre_x, centre_y, middle_x, middle_y, cosine, sine, along):
        """The sums along a row of clusters with one more: (2 of centres from the middle one [m], 2 of what they turn `along`
        into [m], of cosines, of sines); `along`: where the mass lies at rest from its centre, x [m]."""
        return (
            sums[0] + (centre_x - middle_x), sums[1] + (centre_y - middle_y), sums[2] + cosine * along,
            sums[3] + sine * along, sums[4] + cosine, sums[5] + sine,
        )  # fmt: skip

    @compiled
    def added_goal_row(way_x, way_y, sums, x, y, middle_x, middle_y, count, down):
        """The sum of ways from the mass at (x, y) to its goals with those of a row of `count` clusters, whose sums count from
        `middle`; `down`: how far the mass lies below their centres at rest [m]. A rotation takes (along, -down) to
        (cosine along + sine down, sine along - cosine down)."""
        row_x = (sums[0] + count * (middle_x - x)) + (sums[2] + sums[5] * down)
        row_y = (sums[1] + count * (middle_y - y)) + (sums[3] - sums[4] * down)
        return way_x + row_x, way_y + row_y

    @compiled
    def moved(position, row_share, column_share, matching, way):
        """Position [m], one axis, so much of the mean way on; the mass's share in each of its clusters is a product."""
        return position + row_share * column_share * matching * way

    return SimpleNamespace(
        added_member=added_member, added_row=added_row, cluster=cluster, rest_offset=rest_offset, added_goal=added_goal,
        added_goal_row=added_goal_row, moved=moved,
    )  # fmt: skip
