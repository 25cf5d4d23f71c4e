"""Worlds of several families on a real GPU: in exact math the bits of the CPU, in every kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from world_scenes import PARTS, moving, world_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> State:
    with open_simulation(scene, backend, initial=moving(scene), math="exact", **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", PARTS)
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = world_scene(name)
    expected = end_state(scene, "cpu", 20, precision=precision, threads=1)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, "gpu", 20, precision=precision, kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel
        assert np.array_equal(state.rotation, expected.rotation), kernel  # type: ignore[arg-type]
