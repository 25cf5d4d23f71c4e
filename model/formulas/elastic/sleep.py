"""Sleeping vertices: they keep their positions while they and all their neighbours are slow, and still transmit
loads.

A vertex is slow if its speed is below a limit and its velocity changed in the last substep by less than SHARE of the
change by gravity. So a body that begins to fall, or turns at the top of its flight, does not sleep, and a sleeping one
wakes when its support is gone. The net force on a sleeping vertex is within SHARE of its weight.
"""

from __future__ import annotations

from softlab.model.base.variant import formula

GRAVITY_FRACTION = 0.05  # of the velocity that gravity adds in a substep
OPERATIONS = 20


@formula
def is_slow(v, w, speed, gravity, h):
    """True if a vertex of velocity v, which was w a substep of h [s] ago, may sleep."""
    x, y, z, most = v[0] - w[0], v[1] - w[1], v[2] - w[2], GRAVITY_FRACTION * (gravity * h)
    squared = (v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]
    return (squared < speed * speed) & ((x * x + y * y) + z * z < most * most)
