"""Lengths and products of vectors. `fast` math replaces some by approximate instructions."""

from __future__ import annotations

from math import sqrt

from softlab.model.base.variant import formula

# In `fast` math a backend may replace `squared_length` and `inverse_length` by approximate instructions without the
# branch: for coincident masses the inverse length need only be finite, since it is multiplied by a difference of 0.


@formula
def squared_length(dx, dy):
    return dx * dx + dy * dy


@formula
def squared_length_3d(dx, dy, dz):
    return squared_length(dx, dy) + dz * dz


@formula
def inverse_length(squared):
    """1 / sqrt(squared), 0 for 0."""
    return 1.0 / sqrt(squared) if squared > 0.0 else 0.0


@formula
def dot(ax, ay, az, bx, by, bz):
    return (ax * bx + ay * by) + az * bz


@formula
def cross(ax, ay, az, bx, by, bz):
    """a x b: normal to the triangle with these edges; its length is twice the area."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@formula
def moved(point, weight, direction):
    """point + weight * direction, vectors."""
    return point[0] + weight * direction[0], point[1] + weight * direction[1], point[2] + weight * direction[2]


@formula
def length(x, y, z):
    return sqrt((x * x + y * y) + z * z)
