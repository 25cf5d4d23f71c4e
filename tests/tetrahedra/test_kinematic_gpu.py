"""Live targets of pinned vertices on a real GPU: the CPU's bits in exact math."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_scenes import SOLVERS, kinematic_scene

from softlab.app.driver import open_simulation

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("solver", SOLVERS)
def test_targets_are_the_cpus(solver: str) -> None:
    scene, states = kinematic_scene(solver), []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact", live=("targets",)) as simulation:
            for step in range(5):
                simulation.targets(scene.tetrahedra_set.position + 0.01 * step)
                simulation.advance(1 + step % 2)
            states.append(simulation.state())
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].velocity, states[1].velocity)
