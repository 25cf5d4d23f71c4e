"""Small sums of a cloth's step that belong to no other topic: they combine springs, wind and colliders."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain
from softlab.model.formulas.lengths import make as make_lengths


def make(real, compiled=plain):
    """Make `instant`, `moved`, `between`, `pushed`, `mean`, `gusty`, `cross` and `unit` in the arithmetic `real`."""
    one, third = real(1), real(1) / real(3)
    lengths = make_lengths(real, compiled)
    squared_length, inverse_length = lengths.squared_length_3d, lengths.inverse_length

    @compiled
    def instant(step, dt, first_step, first_time):
        """Time [s] at which step number `step` begins. Step number `first_step` begins at `first_time` [s]."""
        return first_time + (real(step) - first_step) * dt

    @compiled
    def moved(point, velocity, time):
        """Position of a collider's point at `time` [s], one axis."""
        return point + velocity * time

    @compiled
    def between(a, b, part):
        """Point at the fraction `part` of the segment from a to b, one axis."""
        return a + part * (b - a)

    @compiled
    def pushed(position, depth, normal):
        """Position of a mass that is pushed out by `depth` [m] along the normal, one axis."""
        return position + depth * normal

    @compiled
    def mean(a, b, c):
        """Mean of a triangle's three corners, one axis."""
        return ((a + b) + c) * third

    @compiled
    def gusty(speed, gust, g):
        """Velocity [m/s] of the wind with gusts, one axis. g is in (-1, 1)."""
        return speed * (one + gust * g)

    @compiled
    def unit(x, y, z):
        """Unit vector along (x, y, z); 0 for 0."""
        inverse = inverse_length(squared_length(x, y, z))
        return x * inverse, y * inverse, z * inverse

    return SimpleNamespace(
        instant=instant, moved=moved, between=between, pushed=pushed, mean=mean, gusty=gusty, cross=lengths.cross, unit=unit,
    )  # fmt: skip
