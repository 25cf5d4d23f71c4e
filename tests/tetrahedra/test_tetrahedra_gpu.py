"""Tetrahedral bodies on a real GPU: the bits of the CPU's in exact math, its states in fast math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import moving, tetrahedra_scene, through

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int, **options: Any) -> State:
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


@pytest.mark.parametrize("kernel", ["resident", "graph"])
def test_a_catalogue_scene_falls_alike(kernel: str) -> None:
    """In exact math, float32: the same bits after a second, contacts with the floor too, not of bodies; resident, three
    launches a call, of bodies with doubled voxels."""
    scene = through(load_scene("fem-drop"))
    expected = end_state(scene, "cpu", 60, math="exact")
    assert np.array_equal(end_state(scene, "gpu", 60, math="exact", kernel=kernel).position, expected.position)


def bar(layers: int, across: int, iterations: int = 1, **changes: Any) -> Scene:
    """Small Steps' cantilever, in such voxels."""
    beam = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [layers / across, 1.0, 1.0]}, "edge": 1 / across,
        "young_modulus": 1e5, "poisson_ratio": 0.4, "pinned": ["left"],
    }  # fmt: skip
    method = {"solver": "xpbd", "dt": 1 / 60, "substeps": 100 // iterations, "iterations": iterations}
    return Scene({"beam": beam | changes, "gravity": {}, "method": method})


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kernel", ["resident:2", "resident:4", "resident:14", "resident:40"])
def test_slabs_of_any_thickness_give_the_same_bits(kernel: str, precision: str) -> None:
    """20, 10, 3 blocks and one, over thousands of meetings, in calls of different lengths."""
    scene = bar(40, 8 if kernel != "resident:40" else 4)
    options: dict[str, Any] = {"precision": precision, "math": "exact", "initial": moving(scene, 1e-3)}
    expected = end_state(scene, "gpu", 8, kernel="graph", **options)
    with open_simulation(scene, "gpu", kernel=kernel, **options) as simulation:
        for steps in (1, 2, 5):
            simulation.advance(steps)
        state = simulation.state()
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


def test_iterations_and_dampers_meet_too() -> None:
    scene = bar(12, 2, iterations=4, damping=0.02)
    options: dict[str, Any] = {"math": "exact", "initial": moving(scene, 1e-2)}
    expected = end_state(scene, "cpu", 5, threads=1, **options)
    assert np.array_equal(end_state(scene, "gpu", 5, kernel="resident:2", **options).position, expected.position)


def test_small_bodies_of_voxels_are_resident() -> None:
    with open_simulation(bar(40, 8), "gpu") as simulation:
        assert simulation.kernel == "resident"
    with open_simulation(tetrahedra_scene("free"), "gpu") as simulation:
        assert simulation.kernel == "graph"
