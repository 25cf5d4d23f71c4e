"""Meshes on a real GPU: the CPU's bits in exact math, fast math near to it, states that go on, normals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mesh_scenes import POKE, mesh_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


def end_state(scene: Scene, backend: str, steps: int = 40, **options: Any) -> State:
    options = {"math": "exact"} | options
    with open_simulation(scene, backend, live=["poke"], **options) as simulation:
        simulation.poke(*POKE)
        simulation.advance(steps // 2)
        simulation.advance(steps - steps // 2)
        return simulation.state()


def same(one: State, other: State) -> bool:
    return np.array_equal(one.position, other.position) and np.array_equal(one.velocity, other.velocity)


def test_the_garment_has_the_cpus_bits() -> None:
    scene = load_scene("cloth-mesh")
    assert same(end_state(scene, "gpu", 12), end_state(scene, "cpu", 12))


def test_fast_math_is_near_exact() -> None:
    """Approximate roots, 2^-22 of a length each, in 12 steps of 10 substeps that add up at worst: 3e-5 of lengths of 1 m."""
    scene = load_scene("cloth-mesh")
    fast, exact = (end_state(scene, "gpu", 12, math=math) for math in ("fast", "exact"))
    np.testing.assert_allclose(fast.position, exact.position, atol=3e-5)


def test_states_change_hands() -> None:
    scene = mesh_scene("everything")
    half, whole = end_state(scene, "cpu", 4), end_state(scene, "cpu", 8)
    with open_simulation(scene, "gpu", math="exact", live=["poke"], initial=half) as gpu:
        gpu.poke(*POKE)
        gpu.advance(4)
        assert same(gpu.state(), whole)


def test_normals_are_the_cpus() -> None:
    """Sums of unit order in float32, in another order: 1e-5."""
    scene = load_scene("cloth-mesh")
    with open_simulation(scene, "gpu") as gpu, open_simulation(scene, "cpu") as cpu:
        np.testing.assert_allclose(gpu.read("normal"), cpu.read("normal"), atol=1e-5)
