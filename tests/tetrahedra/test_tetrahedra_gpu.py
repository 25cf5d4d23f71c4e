"""Which kernel tetrahedral bodies take on a real GPU."""

from __future__ import annotations

import pytest
from tetrahedra_scenes import cantilever, tetrahedra_scene

from softlab.app.driver import open_simulation

pytestmark = pytest.mark.gpu


def test_small_bodies_of_voxels_are_resident() -> None:
    with open_simulation(cantilever(40, 8), "gpu") as simulation:
        assert simulation.kernel == "resident"
    with open_simulation(tetrahedra_scene("free"), "gpu") as simulation:
        assert simulation.kernel == "graph"
