"""Vertex block descent in `fast` math, on the CPU and on a real GPU."""

from __future__ import annotations

import numpy as np
import pytest
from vbd_scenes import EVERYTHING, end_state

from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu


def test_fast_math_rounds_otherwise_alone() -> None:
    scene = Scene(EVERYTHING)
    one, other = (end_state(scene, 2, backend=b, math="fast", threads=t) for b, t in (("cpu", 1), ("gpu", None)))
    np.testing.assert_allclose(other.position, one.position, atol=1e-10)
