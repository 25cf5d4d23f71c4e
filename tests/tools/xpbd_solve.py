"""One way to run a position-based scene on CPU threads, for the tests of its kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from xpbd_scenes import poke_of

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

STEPS = 4


def end_state(scene: Scene, batches: tuple[int, ...] = (STEPS,), **options: Any) -> State:
    """After a poke, in `exact` math."""
    options = {"math": "exact", "precision": "float64", "threads": 1} | options
    with open_simulation(scene, live=("poke",), allow_unstable=True, **options) as simulation:
        if poke_of(scene)[0] < len(simulation.body.position):
            simulation.poke(*poke_of(scene))
        for steps in batches:
            simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)
