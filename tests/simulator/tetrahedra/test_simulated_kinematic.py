"""Moving pins of tetrahedral bodies on CUDA, in plain Python: the bits of the CPU's."""

from __future__ import annotations

import numpy as np
import pytest
from kinematic_scenes import CLAMP, CUBE, ENDS, HOOK, LOOSE, kinematic_scene, run

from softlab.app.driver import open_simulation


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
def test_bits_are_the_cpus(solver: str) -> None:
    slow = LOOSE | {"origin": [0.0, 0.5, 0.0], "velocity": [1.0, 0.5, 0.2], "mass_damping": 3.0}
    scene = kinematic_scene(solver, slow=slow, **ENDS)
    expected = run(scene, 2, precision="float32", math="exact", threads=1)
    for kernel in ("launch", "stages"):
        state = run(scene, 2, "gpu", precision="float32", math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


@pytest.mark.parametrize("solver", ["xpbd", "vbd"])
def test_attached_bodies_are_the_cpus(solver: str) -> None:
    scene = kinematic_scene(solver, bar=LOOSE, cube=CUBE, hook=HOOK, clamp=CLAMP)
    expected = run(scene, 2, precision="float32", math="exact", threads=1)
    for kernel in ("launch", "stages"):
        state = run(scene, 2, "gpu", precision="float32", math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel


def test_vertices_that_keep_their_places_are_the_cpus() -> None:
    method = {"solver": "xpbd", "dt": 0.01, "substeps": 2, "sleeping_speed": 0.05}
    scene = kinematic_scene(
        "xpbd", gravity={"acceleration": 2.0}, method=method, slow=LOOSE | {"origin": [0.0, 0.5, 0.0]}
    )
    expected = run(scene, 2, precision="float32", math="exact", threads=1)
    for kernel in ("launch", "stages"):
        state = run(scene, 2, "gpu", precision="float32", math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_targets_are_the_cpus() -> None:
    scene, states = kinematic_scene("xpbd"), []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, precision="float64", math="exact", live=("targets",)) as simulation:
            simulation.targets(scene.tetrahedra_set.position + 0.01)
            simulation.advance(2)
            states.append(simulation.state())
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].velocity, states[1].velocity)
