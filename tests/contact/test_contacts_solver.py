"""A cloth that touches itself, by its solver: the reference's motion, threads, what is refused."""

from __future__ import annotations

from typing import Any

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

# ---------------------------------------------------------------------- in the solver


def end_state(scene: Scene, steps: int, **options: Any) -> State:
    with open_simulation(
        scene, "cpu", **{"precision": "float64", "math": "exact", "threads": 1} | options
    ) as simulation:
        simulation.advance(steps)
        return simulation.state()


# ---------------------------------------------------------------------- scenes that cannot be
