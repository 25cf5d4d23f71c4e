"""Position-based dynamics of springs: the prediction, the projection of a distance constraint, the velocity after it.

M. Macklin, M. Mueller, N. Chentanez, "XPBD: Position-Based Simulation of Compliant Constrained Dynamics", MIG 2016, eq.
18 and 26; M. Mueller et al., "Position Based Dynamics", 2006. The mass unit is that of the sheet's masses: a mass has
the weight w = 1, or 0 where it is pinned. The compliance is alpha m / h^2 (dimensionless), the multiplier lambda / m
[m]. One constraint |d| = rest is one implicit Euler step of its spring and damper, exact except for the rotation of d
within the step.
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import inverse_length

OPERATIONS_RIGID = (
    22  # 3 differences, 5 for the square, 2 for 1/length, 4 for the change, 1 for its scale, 6 to apply it
)
OPERATIONS_SOFT = 25  # as above, and 3 for the multiplier
OPERATIONS_DAMPER = 26  # 6 differences, 10 for the products, 10
OPERATIONS_PREDICT = 5  # per axis: the kick and the drift
OPERATIONS_UPDATE = 2  # per axis
OPERATIONS_ATTACHMENT = 20


@formula
def reciprocal(weight, stiffening, compliance):
    """1 over the denominator of a projection, 0 where nothing can move. `weight`: the sum of the ends' weights;
    `stiffening`: 1 + gamma of the damper, or 1 / stiffness in PBD."""
    return 1.0 / (stiffening * weight + compliance) if weight > 0.0 else 0.0


@formula
def rigid_change(squared, rest, reciprocal):
    """Return (change of the multiplier, that over the length) of an inextensible constraint.

    Both are 0 where the ends coincide and so have no direction. `squared`: |d|^2. The ends move by -+ weight *
    scale * d.
    """
    inverse = inverse_length(squared)
    change = (rest - squared * inverse) * reciprocal if squared > 0.0 else 0.0
    return change, change * inverse


@formula
def soft_change(squared, rest, reciprocal, compliance, multiplier):
    """Return (change, change over length) of a constraint with a compliance; `multiplier`: its value so far in this
    substep (eq. 18)."""
    inverse = inverse_length(squared)
    change = 0.0
    if squared > 0.0:
        change = ((rest - squared * inverse) - compliance * multiplier) * reciprocal
    return change, change * inverse


@formula
def lengthened(squared, length, along, passed):
    """|d| - |d - e| = e . (2 d - e) / (|d| + |d - e|), in which no large numbers cancel."""
    gained = (along + along) - passed
    before = squared - gained
    if before > 0.0:
        length = length + before * inverse_length(before)
    return gained / length


@formula
def damped_change(squared, rest, reciprocal, compliance, multiplier, damping, along, passed):
    """Return (change, change over length) of a constraint with a compliance and a damper along the spring.

    `along`: d . e, `passed`: e . e, with e the change of d in this substep; `damping`: gamma = alpha beta / h. The
    rate is that of the length, (C - C_before) / h in place of eq. 26's grad C . (x - x_before) / h, to which it
    tends. It is 0 in a rigid rotation, in which the other one would pull.
    """
    inverse = inverse_length(squared)
    change = 0.0
    if squared > 0.0:
        length = squared * inverse
        stretch = (length - rest) + damping * lengthened(squared, length, along, passed)
        change = (-stretch - compliance * multiplier) * reciprocal
    return change, change * inverse


@formula
def along_2d(dx, dy, ex, ey):
    return dx * ex + dy * ey


@formula
def moved(position, weight, scale, d):
    """Position of a constraint's second end after its projection, one axis. The first end takes -scale."""
    return position + weight * (scale * d)


@formula
def tether(squared, max_distance):
    """Factor that shortens the vector d from an anchor to at most `max_distance` [m]."""
    return max_distance * inverse_length(squared) if squared > max_distance * max_distance else 1.0


@formula
def tethered(position, anchor, d, factor):
    """Position after the tether, one axis; unchanged to the bit where the tether does not pull."""
    return anchor + factor * d if factor < 1.0 else position


@formula
def kicked(velocity, factor, h, acceleration):
    """Velocity [m/s] of the prediction, one axis: damped by the factor `factor`, then accelerated."""
    return velocity * factor + h * acceleration


@formula
def damping_factor(drag, weight):
    """Damping factor of the velocity of a mass of that weight: 1 - h c / m."""
    return 1.0 - drag * weight


@formula
def slowed(velocity, rate, h):
    """Velocity [m/s], one axis, after h [s] of a damper of that rate [1/s], which is the same for all masses."""
    return velocity * (1.0 - h * rate)


@formula
def predicted(position, h, velocity):
    """Position [m] before the constraints, one axis."""
    return position + h * velocity


@formula
def rate(position, before, inverse_h):
    """Velocity [m/s] that leads from `before` to `position` in a substep, one axis."""
    return (position - before) * inverse_h


@formula
def added(acceleration, weight, force):
    """Acceleration plus that of a force over the sheet's mass [m/s^2] on a mass of that weight, one axis."""
    return acceleration + weight * force


@formula
def weighted_valence(valence, weight):
    """Contribution of a mass to the denominator of each of its constraints in the weighted Jacobi ordering."""
    return valence * weight


@formula
def scaled(scale, d):
    """Displacement of a constraint's second end for weight 1, one axis, to be summed over a mass's constraints."""
    return scale * d


@formula
def gathered(position, weight, total):
    """Position of a mass after a Jacobi iteration, one axis. `total`: the sum of its displacements."""
    return position + weight * total


@formula
def averaged(position, weight, total, valence):
    """Position of a mass whose displacements are averaged instead of summed, one axis. A mass without constraints
    stays."""
    return position + (weight * total) * (1.0 / valence) if valence > 0.0 else position
