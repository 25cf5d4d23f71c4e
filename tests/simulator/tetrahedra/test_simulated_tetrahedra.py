"""The CUDA kernels of tetrahedral bodies, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

import numpy as np
from tetrahedra_scenes import tetrahedra_scene

from softlab.app.driver import open_simulation


def test_normals_are_those_of_the_surface() -> None:
    """Sums in another order, in float64: rounding. Particles inside have none."""
    scene = tetrahedra_scene("everything")
    found = scene.tetrahedra_set
    with open_simulation(scene, "gpu", precision="float64", math="exact") as simulation:
        normal = simulation.read("normal")
        expected = scene.grid.normals(simulation.read("position"))
    at_surface = np.unique(found.surface)
    np.testing.assert_allclose(normal[at_surface], expected[at_surface], atol=1e-6)
