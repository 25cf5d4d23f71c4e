"""Moving pins, targets, attachments, materials of tetrahedral bodies on a real GPU: the bits of the CPU's in exact math."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_scenes import SOLVERS, kinematic_scene, run

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("name", ["fem-twist", "fem-kinematic", "fem-attached"])
def test_catalogue_scenes_move_alike(name: str) -> None:
    scene = load_scene(name)
    both = [run(scene, 60, backend, math="exact") for backend in ("cpu", "gpu")]
    assert np.array_equal(both[0].position, both[1].position)


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
