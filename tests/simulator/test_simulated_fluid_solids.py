"""Fluids among solids on CUDA, in plain Python: to the bits of the CPU."""

from __future__ import annotations

import numpy as np
import pytest
from solid_scenes import driven, fluid_scene
from test_fluid_solids import WALLED


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("more", [{}, WALLED], ids=["alone", "walls and oil"])
def test_the_bits_are_the_cpus(more: dict, precision: str) -> None:
    """Of the fluid and of the solids that it pushes."""
    scene = fluid_scene(**more)
    ends = [driven(scene, 1, precision, backend=backend) for backend in ("cpu", "gpu")]
    assert all(np.array_equal(one, other) for one, other in zip(*ends, strict=True))
    assert np.abs(ends[0][3] - [0.2, 0, 0])[5:9].max() > 0.01, "no solid was pushed"
