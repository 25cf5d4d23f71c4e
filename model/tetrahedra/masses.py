"""Masses of vertices whose neighbours' masses are not too far apart, in a body that weighs what it did."""

from __future__ import annotations

import numpy as np

from model.geometry.arithmetic.ordered import total
from model.geometry.lists import Lists


def limited(masses: np.ndarray, near: Lists, ratio: float) -> np.ndarray:
    """(vertices,) [kg]: masses of which no vertex has more than `ratio` (>= 1) times what one of its neighbours (`near`)
    has, and whose sum is that of `masses` (vertices,), both to rounding.

    The least masses over and the greatest under the given ones that keep the ratio, U_i = max m_j / ratio^d and L_i = min m_j
    ratio^d with d the edges on the way from i to j, keep it mixed, too: a U + (1 - a) L, with a such that the sum is right.
    """
    over, under = _spread(masses, near, ratio), 1 / _spread(1 / masses, near, ratio)
    room = total(over - under)
    share = total(masses - under) / room if room > 0 else 0.0
    mixed: np.ndarray = share * over + (1 - share) * under
    return mixed * (total(masses) / total(mixed))  # of what rounding left


def _spread(values: np.ndarray, near: Lists, ratio: float) -> np.ndarray:
    """The least numbers over the positive `values` that are at least 1 / ratio of every neighbour's."""
    found = np.array(values, np.float64)
    owner = np.repeat(np.arange(len(found)), near.lengths)
    while True:
        asked = found[near.indices] / ratio
        short = np.flatnonzero(asked > found[owner])
        if not len(short):
            return found
        np.maximum.at(found, owner[short], asked[short])
