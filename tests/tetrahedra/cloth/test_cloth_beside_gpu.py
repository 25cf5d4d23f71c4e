"""A cloth beside tetrahedral bodies on a real GPU: in exact math the bits of the CPU, in fast it holds what falls on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> State:
    with open_simulation(scene, backend, math="exact", **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


def test_bodies_in_a_cloth_move_alike() -> None:
    """Sixty steps, in which they fall into it and come up again."""
    scene = load_scene("fem-cloth")
    both = [end_state(scene, backend, 60) for backend in ("cpu", "gpu")]
    assert np.array_equal(both[0].position, both[1].position)


def test_fast_math_keeps_them_on_it() -> None:
    """After two seconds both bodies are where the cloth is, in its middle or above."""
    scene = load_scene("fem-cloth")
    start = int(scene.tetrahedra_set.first_particle[-1])
    with open_simulation(scene, "gpu") as simulation:
        simulation.advance(120)
        position = simulation.read("position")
    assert np.isfinite(position).all()
    assert position[:start, 1].min() > position[start:, 1].min() - 0.02
