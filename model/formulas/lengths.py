"""Lengths: what springs, wind and colliders share, and what `fast` math replaces by approximate instructions."""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

from model.formulas import plain


def make(real, compiled=plain):
    """`squared_length`, `squared_length_3d`, `inverse_length` in the arithmetic `real`."""
    zero, one = real(0), real(1)

    # In `fast` math a backend may replace the first and the last, by approximate instructions and without the branch: for
    # coincident masses the inverse length need only be finite, since it is multiplied by a difference of 0.

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

    return SimpleNamespace(
        squared_length=squared_length, squared_length_3d=squared_length_3d, inverse_length=inverse_length
    )
