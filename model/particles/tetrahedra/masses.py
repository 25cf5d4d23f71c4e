"""Masses of vertices with a limited ratio between neighbours, in a body of unchanged mass."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import total
from softlab.model.geometry.lists import Lists


def limited(masses: np.ndarray, near: Lists, ratio: float) -> np.ndarray:
    """Return masses (vertices,) [kg] of which none exceeds `ratio` (>= 1) times that of a neighbour (`near`).

    Their sum is that of `masses` (vertices,), both to rounding. The smallest masses above and the largest below the
    given ones with that ratio, U_i = max m_j / ratio^d and L_i = min m_j ratio^d with d the number of edges from i to
    j, also have it when mixed: a U + (1 - a) L, with a such that the sum is right.
    """
    over, under = _spread(masses, near, ratio), 1 / _spread(1 / masses, near, ratio)
    difference = total(over - under)
    fraction = total(masses - under) / difference if difference > 0 else 0.0
    mixed: np.ndarray = fraction * over + (1 - fraction) * under
    return mixed * (total(masses) / total(mixed))  # removes the rounding of the sum


def _spread(values: np.ndarray, near: Lists, ratio: float) -> np.ndarray:
    """Return the smallest numbers above the positive `values` that are at least 1 / ratio of every neighbour's."""
    bounds = np.array(values, np.float64)
    owner = np.repeat(np.arange(len(bounds)), near.lengths)
    while True:
        asked = bounds[near.indices] / ratio
        short = np.flatnonzero(asked > bounds[owner])
        if not len(short):
            return bounds
        np.maximum.at(bounds, owner[short], asked[short])
