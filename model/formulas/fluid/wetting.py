"""A cloth that drinks: where water touches it, it grows wet, and elsewhere it dries; wet, it is heavier.

Of each particle a share of what it can hold, which modifies its mass: the saturation model of Y. Chen, N. Magnenat Thalmann
and B. Foster Allen, "Physical simulation of wet clothing for virtual humans", The Visual Computer 28 (2012), at its
simplest: no water goes from one particle to the next.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

OPERATIONS = 12  # a particle: its share and its weight


def make(real, compiled=plain):
    """See the functions; in the arithmetic `real`."""
    one = real(1)

    @compiled
    def soaked(wetness, touched, soaking, drying):
        """The share of what it can hold, 0 to 1, after a substep: `soaking`, `drying`: of what is missing, or is there, how
        much comes, or goes, in it."""
        return wetness + soaking * (one - wetness) if touched else wetness - drying * wetness

    @compiled
    def lighter(dry, wetness, capacity):
        """An inverse mass, or a lightness, of what is wet; `capacity`: mass of water over that of dry cloth, at most."""
        return dry / (one + capacity * wetness)

    @compiled
    def given_way(a, b, c, light_a, light_b, light_c):
        """How much a sample between three particles gives way: their shares squared times their lightness."""
        return ((a * a) * light_a + (b * b) * light_b) + (c * c) * light_c

    return SimpleNamespace(soaked=soaked, lighter=lighter, given_way=given_way)
