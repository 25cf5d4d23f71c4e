"""What a step takes from, or adds to, an undamped oscillation by itself, by theory."""

from __future__ import annotations

from functools import cache
from math import log

import numpy as np

from bench.experiments.findings import oscillator
from model.core.integrators import amplification_matrix

NOTHING = 1e-10  # 1/s: rounding of the measurement; rates under it are called none


def theory(scheme: str, dt: float) -> float:
    """The rate [1/s] at which the amplitude falls (negative: grows): -ln |eigenvalue of one step| / dt.

    Of the oscillator of bench/experiments/findings.py, from the step's matrix (model/core/integrators.py).
    """
    matrix = amplification_matrix(scheme, dt, _frequency(), 0.0)
    return -log(float(np.abs(np.linalg.eigvals(matrix)).max())) / dt


@cache
def _frequency() -> float:
    """Of the oscillator [1/s], which is one of the same mass and spring under every scheme."""
    scene = oscillator("lab", 0.01)
    assert scene.springs is not None
    return float((scene.springs.stiffness / scene.grid.mass) ** 0.5)
