"""Shape matching of grids on a real GPU: the CPU's bits in exact math, fast math near to it."""

from __future__ import annotations

import numpy as np
import pytest
from test_matching import end_state, everything

pytestmark = pytest.mark.gpu


def test_fast_math_is_near() -> None:
    """100 steps of some 100 operations: 1e4 roundings of coordinates of 70 m at most."""
    scene = everything(1, 2, 1).replace({"grid.rows": 70, "grid.columns": 45})
    exact, fast = (end_state(scene, "gpu", precision="float32", math=math, steps=100) for math in ("exact", "fast"))
    assert np.abs(exact.position - fast.position).max() < 1e4 * 70 * 2.0**-24
