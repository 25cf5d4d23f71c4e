"""Chebyshev acceleration of sweeps: after each, a vertex moves on along its displacement since the sweep before the
last.

H. Wang, "A Chebyshev Semi-Iterative Approach for Accelerating Projective and Position-Based Dynamics", ACM TOG 34
(2015), eq. 11 and 12, from the third sweep on; A. H. Chen et al., "Vertex Block Descent", ACM TOG 43 (2024), eq. 18 and
19. `rho` is the factor by which a sweep reduces the slowest error. Too large a `rho` diverges, since sweeps are not a
linear iteration.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.variant import formula

OPERATIONS = 9


def weights(rho: float, iterations: int, real: type) -> np.ndarray:
    """Return w of each sweep, (iterations,), 1 for the first two, in the arithmetic `real`."""
    squared, factors = real(rho) * real(rho), [real(1), real(1)]
    for number in range(2, iterations):
        factors.append(real(2) / (real(2) - squared) if number == 2 else real(4) / (real(4) - squared * factors[-1]))
    return np.array(factors[:iterations], real)


@formula
def beyond(x, older, w):
    """Extrapolated position, one axis. x: after this sweep; `older`: after the sweep before the last, read only
    where w is not 1."""
    if w == 1.0:
        return x
    return older + w * (x - older)
