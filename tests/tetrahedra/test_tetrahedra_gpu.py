"""Tetrahedral bodies on a real GPU: the bits of the CPU's in exact math, its states in fast math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import PARTS, moving, tetrahedra_scene

from app.driver import open_simulation
from model.core.simulation import State
from model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> State:
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", PARTS)
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = tetrahedra_scene(name)
    options: dict[str, Any] = {"precision": precision, "math": "exact", "initial": moving(scene)}
    expected = end_state(scene, "cpu", 20, threads=1, **options)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, "gpu", 20, kernel=kernel, **options)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_a_catalogue_scene_falls_alike() -> None:
    """In exact math, float32: the same bits after a second, contacts with the floor too."""
    scene = load_scene("fem-drop")
    both = [end_state(scene, backend, 60, math="exact") for backend in ("cpu", "gpu")]
    assert np.array_equal(both[0].position, both[1].position)
