"""The CUDA kernels of tetrahedral bodies, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import moving, tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    with open_simulation(scene, backend, initial=moving(scene), math="exact", **options) as simulation:
        simulation.advance(1)
        return simulation.state()


@pytest.mark.parametrize(
    "name,precision",
    [
        ("everything", "float32"),
        ("damped", "float64"),
        ("corotated", "float64"),
        ("damped blocks", "float32"),
        ("damped hookean", "float64"),
        ("hookean once", "float32"),
        ("hookean voxels", "float32"),
        ("once", "float32"),
        ("free", "float32"),
        ("voxels", "float32"),
    ],
)
def test_bits_are_the_cpus(name: str, precision: str) -> None:
    scene = tetrahedra_scene(name)
    expected = end_state(scene, "cpu", precision=precision, threads=1)
    for kernel in ("launch", "stages"):
        state = end_state(scene, "gpu", precision=precision, kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_normals_are_those_of_the_surface() -> None:
    """Sums in another order, in float64: rounding. Particles inside have none."""
    scene = tetrahedra_scene("everything")
    found = scene.tetrahedra_set
    with open_simulation(scene, "gpu", precision="float64", math="exact") as simulation:
        normal = simulation.read("normal")
        expected = scene.grid.normals(simulation.read("position"))
    at_surface = np.unique(found.surface)
    np.testing.assert_allclose(normal[at_surface], expected[at_surface], atol=1e-6)
