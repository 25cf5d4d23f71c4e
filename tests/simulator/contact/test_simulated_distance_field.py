"""Bodies and cloths on a distance field that moves and turns, by CUDA kernels in plain Python: to the bits of the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from field_scenes import FALLING

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

NAMES = ["bar", "semi-implicit-euler", "velocity-verlet", "rk4", "implicit-euler", "xpbd", "mesh"]


def end_state(scene: Scene, backend: str = "cpu", **options: Any) -> State:
    """In float32, whose roundings tell most."""
    if backend == "cpu":
        options["threads"] = 1
    with open_simulation(
        scene, backend, precision="float32", math="exact", allow_unstable=True, **options
    ) as simulation:
        simulation.advance(4)
        return simulation.state()


@pytest.mark.parametrize("name", NAMES)
def test_the_bits_of_the_cpu(name: str) -> None:
    given = {"origin": [0.0, 0.05, 0.0], "restitution": 0.4}
    host = end_state(FALLING[name](**given))
    free = end_state(FALLING[name](**given | {"origin": [0.0, -50.0, 0.0]}))
    assert (host.velocity != free.velocity).any(axis=1).sum() > 10
    for kernel in (None, "stages") if name == "bar" else (None,):
        found = end_state(FALLING[name](**given), "gpu", kernel=kernel)
        assert np.array_equal(found.position, host.position), kernel
        assert np.array_equal(found.velocity, host.velocity), kernel
