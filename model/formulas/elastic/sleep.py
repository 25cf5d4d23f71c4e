"""Vertices that keep their places while they and all their neighbours are slow, and bear what they weigh.

Slow is who moves slower than a speed, and changed its velocity in the last substep by less than SHARE of what gravity would:
what begins to fall, or turns at the top of its flight, does not sleep, and who sleeps wakes when what bears it is gone. Who
sleeps is within SHARE of its weight of an equilibrium.
"""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain

SHARE = 0.05  # of what gravity adds to a velocity
OPERATIONS = 20


def make(real, compiled=plain):
    """See the function."""
    share = real(SHARE)

    @compiled
    def is_slow(v, w, speed, gravity, h):
        """Whether one of velocity v, which was w a substep of h [s] ago, may sleep."""
        x, y, z, most = v[0] - w[0], v[1] - w[1], v[2] - w[2], share * (gravity * h)
        squared = (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]
        return (squared < speed * speed) & ((x * x + y * y) + z * z < most * most)

    return SimpleNamespace(is_slow=is_slow)
