"""Worlds with water on a real GPU: in exact math the bits of the CPU, in every kernel."""

from __future__ import annotations

import numpy as np
import pytest
from test_world_gpu import end_state
from wet_scenes import PARTS, wet_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", PARTS)
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = wet_scene(name)
    expected = end_state(scene, "cpu", 20, precision=precision, threads=1)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, "gpu", 20, precision=precision, kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel
