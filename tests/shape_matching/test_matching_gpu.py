"""Shape matching of grids on a real GPU: the CPU's bits in exact math, fast math near to it."""

from __future__ import annotations

import numpy as np
import pytest
from test_matching import end_state, everything

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("region,substeps,iterations", [(1, 1, 1), (1, 2, 3), (3, 2, 2)])
def test_bits_are_the_cpus(region: int, substeps: int, iterations: int, precision: str) -> None:
    scene = everything(region, substeps, iterations).replace({"grid.rows": 70, "grid.columns": 45})
    host = end_state(scene, poked=True, precision=precision, steps=100)
    for kernel in ("graph", "launch", "stages"):
        device = end_state(scene, "gpu", poked=True, precision=precision, kernel=kernel, steps=100)
        assert np.array_equal(host.position, device.position), kernel
        assert np.array_equal(host.velocity, device.velocity), kernel


def test_fast_math_is_near() -> None:
    """100 steps of some 100 operations: 1e4 roundings of coordinates of 70 m at most."""
    scene = everything(1, 2, 1).replace({"grid.rows": 70, "grid.columns": 45})
    exact, fast = (end_state(scene, "gpu", precision="float32", math=math, steps=100) for math in ("exact", "fast"))
    assert np.abs(exact.position - fast.position).max() < 1e4 * 70 * 2.0**-24
