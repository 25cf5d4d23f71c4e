"""The CUDA kernels of vertex block descent, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vbd_scenes import BODY, EVERYTHING, FREE, METHOD, end_state, vbd_scene

from softlab.model.scene.scene import Scene

NEAR: dict[str, Any] = {
    "body": BODY, "second": FREE | {"origin": [0.22, 0.03, 0.01], "velocity": [-1.0, 0.0, 0.2], "spin": [0.0] * 3},
    "contact": {"distance": 0.03, "static_friction": 0.3, "dynamic_friction": 0.2}
}  # fmt: skip
SCENES: dict[str, Any] = {
    "everything": lambda: Scene(EVERYTHING),
    "alone": lambda: vbd_scene(BODY, iterations=1),
    "meeting": lambda: Scene(NEAR | {"method": METHOD | {"substeps": 2, "iterations": 3, "chebyshev": 0.8}}),
}


@pytest.mark.parametrize("name,precision", [("everything", "float32"), ("alone", "float64"), ("meeting", "float32")])
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = SCENES[name]()
    expected = end_state(scene, 1, precision=precision)
    assert np.isfinite(expected.position).all()
    for kernel in ("launch", "stages"):
        state = end_state(scene, 1, backend="gpu", precision=precision, kernel=kernel, threads=None)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel
