"""How a rigid body keeps its momenta to rounding: its velocities are a rigid motion of what it had, not a way over h.

Matching has no momenta, sum m g = 0 and sum m (x' - c) x g = 0 for its ways g (M. Mueller et al., SIGGRAPH 2005, eq. 7: A
R' is symmetric), but for what is rounded: positions to their last digit, a goal to a few of them, of a body at rest always to
the same side. A velocity (x' - x) / h holds that, and every substep adds it again, as an acceleration of a rounding over
h^2. So a particle of a rigid body has a *travel* u [m]: h times the velocity with which it is predicted, and what contacts
and others do to its place, without what matching does. The body's velocity is the rigid motion about where it comes to that
has the momenta of u / h (pace.py): linear momentum stays to rounding. Of the angular one a substep h leaves the cosine of
its turn, atan(omega h): tan D' = sin D of the turns D, omega = omega0 / sqrt(1 + omega0^2 h t), as matching turns a body by
the arms at the substep's end.

A speed limit and sleep move particles, too, and their travels go along: sum m u stays sum m (x' - x). A travel that is cut
by itself keeps the weight of some particles and drops what contacts pushed others by: up to 0.74 m g h were given a substep.
Where sleep is asked for, a body none of whose particles moved in a substep, colliders included, has no velocity.

A goal is known to some roundings of the body's size and of its place; what is nearer stays where it is, or the roundings
of a body at rest would move it, again always to one side.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from model.formulas import plain

OPERATIONS_PREDICT = 1  # per axis
OPERATIONS_RATE = 1  # per axis
ROUNDINGS = 2  # of a coordinate, in its last digits: of a goal, of a centre


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`, each for one axis."""
    zero, last_digit = real(0), real(ROUNDINGS * float(np.finfo(real).eps))

    @compiled
    def travelled(h, velocity):
        """The travel of a prediction [m]."""
        return h * velocity

    @compiled
    def carried(travel, position, before):
        """A travel after something else than matching moved the particle from `before` to `position`."""
        return travel + (position - before)

    @compiled
    def settled(way, slack, position):
        """The way to a goal; 0 where it is no longer than roundings. `slack`: those of the body [m], 0 of no rigid one."""
        return zero if slack > zero and abs(way) <= slack + last_digit * abs(position) else way

    @compiled
    def rate_over(travel, inverse_h):
        """The velocity [m/s] of a travel."""
        return travel * inverse_h

    return SimpleNamespace(travelled=travelled, carried=carried, settled=settled, rate_over=rate_over)
