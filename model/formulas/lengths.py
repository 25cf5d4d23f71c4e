"""Lengths and products of vectors, which most topics share; `fast` math replaces some by approximate instructions."""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from softlab.model.formulas import plain


def make(real, compiled=plain):
    """Make `squared_length`, `squared_length_3d`, `inverse_length`, `dot`, `cross` and `length` in the arithmetic
    `real`.

    The last three are the same in any math.
    """
    zero, one = real(0), real(1)

    # In `fast` math a backend may replace `squared_length` and `inverse_length` by approximate instructions without the
    # branch: for coincident masses the inverse length need only be finite, since it is multiplied by a difference of 0.

    @compiled
    def squared_length(dx, dy):
        return dx * dx + dy * dy

    @compiled
    def squared_length_3d(dx, dy, dz):
        return squared_length(dx, dy) + dz * dz

    @compiled
    def inverse_length(squared):
        """1 / sqrt(squared), 0 for 0."""
        return one / sqrt(squared) if squared > zero else zero

    @compiled
    def dot(ax, ay, az, bx, by, bz):
        return (ax * bx + ay * by) + az * bz

    @compiled
    def cross(ax, ay, az, bx, by, bz):
        """a x b: normal to the triangle with these edges; its length is twice the area."""
        return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx

    @compiled
    def length(x, y, z):
        return sqrt((x * x + y * y) + z * z)

    return SimpleNamespace(
        squared_length=squared_length, squared_length_3d=squared_length_3d, inverse_length=inverse_length, dot=dot,
        cross=cross, length=length,
    )  # fmt: skip
