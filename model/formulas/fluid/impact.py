"""Velocity of a particle at walls: after an impact, and without the rebound that a wall's push would cause.

An impact is inelastic unless the collider has a restitution. The predicted position is first moved out of the
colliders, which absorb the velocity into them; density corrections start there. The contribution of a wall to the
density pushes particles out by their own multiplier, and a correction that a substep leaves undone returns as a
velocity in a later one. So the velocity gained along the wall's normal is removed, but no more than the wall itself has
pushed, until the particle keeps its distance to the wall (J. Moreau's impact law with restitution 0, "Unilateral
contact and dry friction in finite freedom dynamics", CISM 302, 1988).
"""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.lengths import cross


@formula
def after_impact(velocity, position, predicted, inverse_dt):
    """Velocity [m/s], one axis: `velocity` as the colliders left it at `predicted`, plus the corrections since."""
    return velocity + (position - predicted) * inverse_dt


@formula
def wall_push(multiplier, weight, slope, rate, inverse_dt):
    """Change of velocity by a wall [m/s], 0 or more, matching `wall_added`: `slope` times the `rate` at which that
    wall counts among others. Multiplier and slope are 0 or less."""
    return (weight * (multiplier * (slope * rate))) * inverse_dt


@formula
def rebound(v, u, w, n, push):
    """Speed [m/s] to remove from v along the wall's normal n: the excess over the outward speed before the
    corrections (u) and over that of the wall (w), at most `push`."""
    nx, ny, nz = n
    gained = (v[0] * nx + v[1] * ny) + v[2] * nz
    before, wall = (u[0] * nx + u[1] * ny) + u[2] * nz, (w[0] * nx + w[1] * ny) + w[2] * nz
    return min(max(gained - max(before, wall), 0.0), push)


@formula
def without(velocity, speed, n):
    """Velocity minus `speed` along n, one axis."""
    return velocity - speed * n


@formula
def surface_velocity(q, spin, e, p, o):
    """Velocity [m/s] of a collider's point p [m]. Its origin o moves at q; it rotates about e at `spin` [rad/s]."""
    tx, ty, tz = cross(spin * e[0], spin * e[1], spin * e[2], p[0] - o[0], p[1] - o[1], p[2] - o[2])
    return q[0] + tx, q[1] + ty, q[2] + tz
