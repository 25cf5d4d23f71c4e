"""Shape matching of lattices in space: window sums by passes along the axes, one component of a vector at a time.

A. Rivers, D. James, "FastLSM: Fast Lattice Shape Matching for Robust Real-Time Deformation", SIGGRAPH 2007: sums over
windows are sums along z of sums along y of sums along x. A row's sums along x are relative to the mass in its middle,
added from left to right. Along y and z windows are taken in groups of 2 n + 1, n the half-width, all of which contain
the reference b, the place n after the group's first one (or the last place there is). A window's sum is that of the
places before b, added from b downwards, plus that from b on, added upwards. So a pass takes two additions per place,
however wide windows are (M. van Herk, "A fast algorithm for local minimum and maximum filters on rectangular and
octagonal kernels", Pattern Recognition Letters 13, 1992; J. Gil, M. Werman, PAMI 15, 1993, there for minima). Nothing
is subtracted again, unlike in running sums, and positions are relative to masses in the window: so float32 loses
nothing, and errors do not grow along the lattice. Only the sums along x, six of 33 numbers, take longer in wider
windows.

For a window, with weights s, places k from its middle and rest centre c (in spacings), the sums are S = sum s (x - x'),
where another reference x' adds the mass times the difference, and the rotational sums T = sum s (x - x') (k - c), which
do not depend on the reference, as sum s (k - c) = 0. A mass's displacement to its goals is summed up likewise, in the
order z, y, x: of the clusters' centres from a reference, and of their rotations' columns times the mass's rest offset.
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.rotation import OPERATIONS_MATRIX, OPERATIONS_NEAR

OPERATIONS_MEMBER = 3 * 5  # of a row of a window along x
OPERATIONS_MOMENTS = 3 * 2 * (6 + 8) + 3 * (2 + 3 + 3) + 3 * (5 + 6)  # of a mass: scans, their two halves, ends
OPERATIONS_TURN = OPERATIONS_NEAR[4] + OPERATIONS_MATRIX + 18 * 5 + 5
OPERATIONS_GOALS = 3 * 2 * (8 + 7) + 3 * (4 + 3) + 3 * 2 * 5  # of a mass
OPERATIONS_GOAL_MEMBER = 3 * 6  # of a row of clusters along x
OPERATIONS_MOVE = 3 * 2 + 3


@formula
def lever(step, centre):
    """Rest position of a mass along an axis [spacings]: `step` positions from the middle of the window, whose centre of
    mass is `centre` spacings from that."""
    return step - centre


@formula
def part_of(weight, position, reference):
    """Weight of a mass times its position relative to a reference [m]."""
    return weight * (position - reference)


@formula
def part_of_row(weight, total, mass, position, reference):
    """Contribution of sums along a row (or over a slice) of the `mass`, relative to `position`: weighted, and
    relative to another `reference` [m]."""
    return weight * (total + mass * (position - reference))


@formula
def added_turn(turn, part, lever):
    """Rotational sum plus one more `part` times its `lever`: spacings from the rest centre or the reference."""
    return turn + part * lever


@formula
def shifted(total, mass, reference, position):
    """Window's sum relative to its own mass's position instead of the reference [m]."""
    return total + mass * (reference - position)


@formula
def entry(a, b, c, x, y, z):
    """Entry of a matrix product that converts between the lattice's axes and the initial ones."""
    return (a * x + b * y) + c * z


@formula
def centre(total, inverse_slice, inverse):
    """Centre of mass of the window relative to its own mass [m]. The inverse of its mass is a product, of a slice's
    and that along z."""
    return total * (inverse_slice * inverse)


@formula
def added_goal(displacement, total, count, position, reference, lever, column):
    """Sum of displacements to goals plus those of one more row or slice of `count` clusters.

    They are relative to `position` before, and to the `reference` [m] after. The rotation's `column` maps the rest
    offset `lever` [m] along its axis.
    """
    return displacement + ((total + count * (position - reference)) + lever * column)


@formula
def ended(displacement, count, reference, position, lever, column):
    """Sum of displacements of `count` clusters relative to a mass's own position [m], at its position, `lever` [m] from
    the reference along the axis."""
    return (displacement + count * (reference - position)) + lever * column


@formula
def moved(position, displacement, weight_x, weight_y, weight_z, matching):
    """Position [m], one axis, after the fraction `matching` of the mean displacement. The mass's weight in each of
    its clusters is a product."""
    return position + ((weight_x * weight_y) * (weight_z * matching)) * displacement
