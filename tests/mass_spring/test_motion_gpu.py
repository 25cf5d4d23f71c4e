"""Pins follow their path on a real GPU in `fast` math."""

from __future__ import annotations

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.bench.reference import cloth as reference_cloth
from softlab.model.core.build import build
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("kernel", ["graph", "launch", "stages"])
def test_pins_are_where_their_motion_has_them_in_fast_math(kernel: str) -> None:
    """To rounding: of the time two units in the last place, of seconds and turns one each, over a radius of 0.7 m; and some
    eight of sums of coordinates up to 2.4 m."""
    scene = load_scene("cloth-twist")
    pinned, dt = build(scene).pinned, scene.method.dt
    with open_simulation(scene, "gpu", math="fast", kernel=kernel) as simulation:
        simulation.advance(500)
        position = simulation.state().position
    still = np.zeros((scene.grid.rows, scene.grid.columns, 3))
    expected, _ = reference_cloth.follow(scene, reference_cloth.rest(scene), still, 500 * dt)
    motion = next(iter(scene.motions.values()))
    angle = abs(motion.angular_velocity) * min(500 * dt, motion.duration)
    bound = np.finfo(np.float32).eps * (0.7 * (5 * angle + 8) + 8 * 2.4)
    assert np.abs(position[pinned] - expected.reshape(-1, 3)[pinned]).max() < bound
