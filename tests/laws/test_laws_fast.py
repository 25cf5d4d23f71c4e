"""A sample of the laws in fast math, as machine code: what fusing and approximating could break."""

from __future__ import annotations

import pytest
import test_law_fall as fall
import test_law_momentum as momentum
from lab import Lab
from rows import BY_NAME

SAMPLE = ("grid, velocity-verlet", "soft_body", "tetrahedra, xpbd blocks fixed-corotated")


@pytest.mark.parametrize("name", SAMPLE)
def test_laws_hold_in_fast_math(name: str) -> None:
    """Fall and momentum, with the laws' own tolerances for roundings eight times as large (`Lab.unit`)."""
    lab = Lab("cpu", "float32", "fast")
    fall.test_free_fall_and_straight_flight(BY_NAME[name], "fall", lab)
    momentum.test_linear_momentum(BY_NAME[name], "", lab)
