"""Wetting of a cloth: it grows wet in contact with water and dries elsewhere; wet, it is heavier.

Each particle has a saturation, which modifies its mass: the saturation model of Y. Chen, N. Magnenat Thalmann and B.
Foster Allen, "Physical simulation of wet clothing for virtual humans", The Visual Computer 28 (2012), in its simplest
form: no water moves between particles.
"""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain

OPERATIONS = 12  # a particle: its saturation and its weight


def make(real, compiled=plain):
    """Make the functions of wetting in the arithmetic `real`."""
    one = real(1)

    @compiled
    def soaked(wetness, touched, soaking, drying):
        """Saturation, 0 to 1, after a substep. `soaking`: fraction of the missing water that is absorbed in it;
        `drying`: fraction of the water that dries in it."""
        return wetness + soaking * (one - wetness) if touched else wetness - drying * wetness

    @compiled
    def lighter(dry, wetness, capacity):
        """Inverse mass, or lightness, of a wet particle. `capacity`: largest mass of water over that of dry cloth."""
        return dry / (one + capacity * wetness)

    @compiled
    def given_way(a, b, c, light_a, light_b, light_c):
        """Mobility of a sample between three particles: the sum of their weights squared times their lightness."""
        return ((a * a) * light_a + (b * b) * light_b) + (c * c) * light_c

    return SimpleNamespace(soaked=soaked, lighter=lighter, given_way=given_way)
