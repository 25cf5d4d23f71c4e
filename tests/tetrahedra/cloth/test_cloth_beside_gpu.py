"""A cloth holds the bodies that fall on it, on a real GPU in `fast` math."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


def test_fast_math_keeps_them_on_it() -> None:
    """After two seconds both bodies are where the cloth is, in its middle or above."""
    scene = load_scene("fem-cloth")
    start = int(scene.tetrahedra_set.first_particle[-1])
    with open_simulation(scene, "gpu") as simulation:
        simulation.advance(120)
        position = simulation.read("position")
    assert np.isfinite(position).all()
    assert position[:start, 1].min() > position[start:, 1].min() - 0.02
