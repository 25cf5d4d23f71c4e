"""Colliders hold a cloth on a real GPU in `fast` math."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


def test_colliders_hold_in_fast_math() -> None:
    """What masses may not enter they do not, whichever way a rounding went: no nearer than the thickness less a few
    epsilon of a coordinate, and the sheet has come down on the ball by then."""
    scene = load_scene("cloth-sphere")
    with open_simulation(scene, "gpu", math="fast") as simulation:
        simulation.advance(2000)
        position = simulation.state().position.astype(np.float64)
    ball, thickness = scene.colliders[1][1], scene.colliders[1][1].thickness
    gap = np.linalg.norm(position - ball.center, axis=1) - ball.radius
    least = thickness - 8 * np.finfo(np.float32).eps
    assert least < gap.min() < thickness + 0.01
