"""A cloth beside tetrahedral bodies on a real GPU: in exact math the bits of the CPU, in fast it holds what falls on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from beside_scenes import crumpled_state, on_cloth, tied

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> State:
    with open_simulation(scene, backend, math="exact", **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("make", [on_cloth, tied])
def test_bits_are_the_cpus(make: Any, precision: str) -> None:
    scene = make()
    options: dict[str, Any] = {"precision": precision, "initial": crumpled_state(scene)}
    expected = end_state(scene, "cpu", 20, threads=1, **options)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, "gpu", 20, kernel=kernel, **options)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


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
