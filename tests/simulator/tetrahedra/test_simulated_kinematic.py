"""Live targets of pinned vertices on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_scenes import kinematic_scene

from softlab.app.driver import open_simulation


@pytest.mark.parametrize("solver", ["xpbd", pytest.param("newton", marks=pytest.mark.rest)])
def test_targets_are_the_cpus(solver: str) -> None:
    scene, states = kinematic_scene(solver), []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, precision="float64", math="exact", live=("targets",)) as simulation:
            simulation.targets(scene.tetrahedra_set.position + 0.01)
            simulation.advance(2)
            states.append(simulation.state())
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].velocity, states[1].velocity)
