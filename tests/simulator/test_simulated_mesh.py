"""The CUDA kernels of meshes, in plain Python: the bits of the CPU's, pass by pass and stage by stage; the reference's
state."""

from __future__ import annotations

import numpy as np
from mesh_scenes import mesh_scene

from softlab.app.driver import open_simulation
from softlab.model.geometry.tables import wind_lists
from softlab.model.geometry.topology import mesh_of


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
