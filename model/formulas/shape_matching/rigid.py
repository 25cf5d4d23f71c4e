"""Momenta of a rigid body to rounding: its velocities are the rigid motion of its momenta, not a displacement over h.

Matching adds no momenta, sum m g = 0 and sum m (x' - c) x g = 0 for its displacements g (M. Mueller et al., SIGGRAPH
2005, eq. 7: A R' is symmetric), except for rounding: positions to their last digit, a goal to a few of them, for a body
at rest always to the same side. A velocity (x' - x) / h contains that, and every substep adds it again, as an
acceleration of a rounding over h^2. So a particle of a rigid body has a *travel* u [m]: h times its predicted velocity,
plus the displacements by contacts and others, without those of matching. The body's velocity is the rigid motion about
its new position that has the momenta of u / h (pace.py): linear momentum is conserved to rounding. A substep h
multiplies the angular one by the cosine of its turn, atan(omega h): tan D' = sin D of the turns D, omega = omega0 /
sqrt(1 + omega0^2 h t), as matching rotates a body by the arms at the substep's end.

A speed limit and sleep move particles, too, and their travels follow: sum m u stays sum m (x' - x). A travel that is
limited on its own preserves the weight of some particles and drops the pushes of contacts on others: up to 0.74 m g h
were gained per substep. With sleep, a body none of whose particles moved in a substep, colliders included, has no
velocity.

A goal is accurate to some roundings of the body's size and of its position. Shorter displacements are dropped, or the
roundings of a body at rest would move it, again always to one side.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import OfPrecision, formula

OPERATIONS_PREDICT = 1  # per axis
OPERATIONS_RATE = 1  # per axis
ROUNDINGS = 2  # of a coordinate, in its last digits: of a goal and of a centre

LAST_DIGIT = OfPrecision(lambda real: ROUNDINGS * float(np.finfo(real).eps))


@formula
def travelled(h, velocity):
    """Travel of a prediction [m]."""
    return h * velocity


@formula
def carried(travel, position, before):
    """Travel after something other than matching moved the particle from `before` to `position`."""
    return travel + (position - before)


@formula
def settled(displacement, slack, position):
    """Displacement to a goal; 0 where it is no longer than roundings. `slack`: those of the body [m], 0 if it is
    not rigid."""
    return 0.0 if slack > 0.0 and abs(displacement) <= slack + LAST_DIGIT * abs(position) else displacement


@formula
def rate_over(travel, inverse_h):
    """Velocity [m/s] of a travel."""
    return travel * inverse_h
