"""The CUDA kernels of vertex block descent, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vbd_scenes import BODY, EVERYTHING, end_state, vbd_scene

from model.scene.scene import Scene

SCENES: dict[str, Any] = {"everything": lambda: Scene(EVERYTHING), "alone": lambda: vbd_scene(BODY, iterations=1)}


@pytest.mark.parametrize("name,precision", [("everything", "float32"), ("alone", "float64")])
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = SCENES[name]()
    expected = end_state(scene, 1, precision=precision)
    assert np.isfinite(expected.position).all()
    for kernel in ("launch", "stages"):
        state = end_state(scene, 1, backend="gpu", precision=precision, kernel=kernel, threads=None)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel
