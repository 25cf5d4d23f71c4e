"""The CUDA kernels of tetrahedral bodies, in plain Python: the bits of the CPU's, pass by pass and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tetrahedra_scenes import tetrahedra_scene

from softlab.app.driver import open_simulation
from softlab.gpu_backend.core.formulas import _refuse_attributes
from softlab.model.formulas import plain
from softlab.model.formulas.elastic import deformation


def test_normals_are_those_of_the_surface() -> None:
    """Sums in another order, in float64: rounding. Particles inside have none."""
    scene = tetrahedra_scene("everything")
    found = scene.tetrahedra_set
    with open_simulation(scene, "gpu", precision="float64", math="exact") as simulation:
        normal = simulation.read("normal")
        expected = scene.grid.normals(simulation.read("position"))
    at_surface = np.unique(found.surface)
    np.testing.assert_allclose(normal[at_surface], expected[at_surface], atol=1e-6)


def make(real: Any, compiled: Any = plain) -> Any:
    return deformation.make_gradient(real, compiled)


def test_a_factory_that_would_not_be_rewritten_is_refused() -> None:
    """Called as an attribute of its module, its products would be contracted, and bits would differ on a GPU alone."""
    with pytest.raises(TypeError, match="import make_gradient by its name"):
        _refuse_attributes(make, globals())
