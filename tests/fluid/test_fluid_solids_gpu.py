"""Fluids among solids on a real GPU: the bits of the CPU in exact math."""

from __future__ import annotations

import numpy as np
import pytest
from solid_scenes import driven, fluid_scene
from test_fluid_solids import WALLED

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("more", [{}, WALLED], ids=["alone", "walls and oil"])
def test_the_bits_are_the_cpus(more: dict, precision: str) -> None:
    scene = fluid_scene(**more)
    ends = [driven(scene, 20, precision, backend=backend) for backend in ("cpu", "gpu")]
    assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))
