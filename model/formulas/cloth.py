"""Small sums of a cloth's step that belong to no other topic: they combine springs, wind and colliders."""

from __future__ import annotations

from softlab.model.base.variant import formula, real
from softlab.model.formulas.lengths import inverse_length, squared_length_3d

THIRD = 1.0 / 3.0


@formula
def instant(step, dt, first_step, first_time):
    """Time [s] at which step number `step` begins. Step number `first_step` begins at `first_time` [s]."""
    return first_time + (real(step) - first_step) * dt


@formula
def moved(point, velocity, time):
    """Position of a collider's point at `time` [s], one axis."""
    return point + velocity * time


@formula
def between(a, b, part):
    """Point at the fraction `part` of the segment from a to b, one axis."""
    return a + part * (b - a)


@formula
def pushed(position, depth, normal):
    """Position of a mass that is pushed out by `depth` [m] along the normal, one axis."""
    return position + depth * normal


@formula
def mean(a, b, c):
    """Mean of a triangle's three corners, one axis."""
    return ((a + b) + c) * THIRD


@formula
def gusty(speed, gust, g):
    """Velocity [m/s] of the wind with gusts, one axis. g is in (-1, 1)."""
    return speed * (1.0 + gust * g)


@formula
def unit(x, y, z):
    """Unit vector along (x, y, z); 0 for 0."""
    inverse = inverse_length(squared_length_3d(x, y, z))
    return x * inverse, y * inverse, z * inverse
