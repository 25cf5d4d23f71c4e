"""The CUDA kernels of meshes, in plain Python: the bits of the CPU's, pass by pass and stage by stage; the reference's
state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mesh_scenes import PARTS, POKE, mesh_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import xpbd_mesh as reference
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.geometry.tables import wind_lists
from softlab.model.geometry.topology import mesh_of, vertex_masses
from softlab.model.scene.scene import Scene

STEPS = 2


def end_state(scene: Scene, backend: str, **options: Any) -> State:
    options = {"math": "exact", "precision": "float64"} | options
    with open_simulation(scene, backend, live=["poke"], **options) as simulation:
        simulation.poke(*POKE)
        simulation.advance(STEPS - 1)
        simulation.advance(1)
        return simulation.state()


@pytest.mark.parametrize("name", PARTS)
def test_states_are_the_references(name: str) -> None:
    """As in test_xpbd_mesh_cpu.py: rounding alone."""
    scene = mesh_scene(name)
    body = build(scene)
    assert scene.mesh is not None
    masses = vertex_masses(scene.mesh)
    position, velocity = reference.simulate(scene, STEPS, body.position, body.velocity, masses, poke=POKE)
    state = end_state(scene, "gpu")
    np.testing.assert_allclose(state.position, position, atol=1e-11)
    np.testing.assert_allclose(state.velocity, velocity, atol=5e-9)


def test_normals_are_those_of_the_triangles() -> None:
    """Sums in another order, in float64: rounding."""
    scene = mesh_scene("everything")
    with open_simulation(scene, "gpu", precision="float64") as simulation:
        simulation.advance(1)
        np.testing.assert_allclose(
            simulation.read("normal"), scene.grid.normals(simulation.read("position")), atol=1e-12
        )  # fmt: skip
    assert scene.mesh is not None
    assert len(wind_lists(mesh_of(scene.mesh))[0]) == 5 * 4 + 1
