"""Refinement of every reference: halve the step until an order-4 method has converged."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Ends = tuple[np.ndarray, np.ndarray]
FOURTH = 8  # ratio of errors with half the step that counts as order 4, whose limit is 16
MAX_SLOW = 2  # largest number of halvings in a row without that order, where the motion is rough


def refine(
    solve: Callable[[int], Ends], steps: int, tolerance: float, most_steps: int, smooth: bool
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return (position, velocity, error estimate [m]) from solve(count), the end state after `count` steps of RK4.

    With order 4 the error of the finer of h and h/2 is their difference / 15, which is removed (Hairer, Norsett,
    Wanner, "Solving ODEs I", II.4). The remaining error is smaller than that difference / 15, whose maximum over the
    masses is the estimate. h is halved until the estimate is below `tolerance` [m], or `most_steps` are reached.

    If the motion is not `smooth` (wind has kinks, contacts are jumps) RK4 may lose its order, so the order is checked
    first: the difference must be at most an eighth of the one before. Otherwise nothing is removed and the whole
    difference is the estimate, which is valid from order 1 on. MAX_SLOW such halvings in a row end the refinement:
    contacts converge too slowly for a tolerance.
    """
    coarse, before, slow = solve(steps), 0.0, 0
    while True:
        fine = solve(2 * steps)
        change = [b - a for a, b in zip(coarse, fine, strict=True)]
        difference = float(np.linalg.norm(change[0], axis=1).max())
        fourth = smooth or difference <= before / FOURTH
        divisor = 15 if fourth else 1
        slow = slow + 1 if before > 0 and not fourth else 0
        if difference / divisor <= tolerance or 4 * steps > most_steps or slow == MAX_SLOW:
            position, velocity = (f + c / 15 if fourth else f for f, c in zip(fine, change, strict=True))
            return position, velocity, difference / divisor
        coarse, before, steps = fine, difference, 2 * steps
