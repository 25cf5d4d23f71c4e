"""Meshes on a real GPU: the CPU's bits in exact math, fast math near to it, states that go on, normals."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


def test_normals_are_the_cpus() -> None:
    """Sums of unit order in float32, in another order: 1e-5."""
    scene = load_scene("cloth-mesh")
    with open_simulation(scene, "gpu") as gpu, open_simulation(scene, "cpu") as cpu:
        np.testing.assert_allclose(gpu.read("normal"), cpu.read("normal"), atol=1e-5)
