"""Moving pins, targets, attachments, materials of tetrahedral bodies on a real GPU: the bits of the CPU's in exact math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kinematic_scenes import BAR, CLAMP, CUBE, ENDS, HOOK, LOOSE, SOLVERS, kinematic_scene, run

from softlab.app.driver import open_simulation
from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu

SLOW = LOOSE | {"origin": [0.0, 0.5, 0.0], "velocity": [1.0, 0.5, 0.2], "mass_damping": 3.0, "mass_ratio": 1.5}
SCENES: dict[str, dict[str, Any]] = {
    "ends": {"slow": SLOW, **ENDS},
    "attached": {"bar": LOOSE, "cube": CUBE, "hook": HOOK, "clamp": CLAMP},
}


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name,solver", [("ends", "xpbd"), ("ends", "vbd"), ("attached", "xpbd"), ("attached", "vbd")])
def test_bits_are_the_cpus(name: str, solver: str, precision: str) -> None:
    scene = kinematic_scene(solver, **SCENES[name])
    expected = run(scene, 20, precision=precision, math="exact", threads=1)
    for kernel in ("graph", "launch", "stages"):
        state = run(scene, 20, "gpu", precision=precision, math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", ["ends", "attached"])
def test_bits_are_the_cpus_by_newtons_method(name: str, precision: str) -> None:
    """With dampers, against which pins work."""
    scene = kinematic_scene("newton", **({"bar": BAR | {"damping": 0.02}} | SCENES[name]))
    expected = run(scene, 20, precision=precision, math="exact", threads=1)
    state = run(scene, 20, "gpu", precision=precision, math="exact")
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_bits_of_vertices_that_sleep(precision: str) -> None:
    method = {"solver": "xpbd", "dt": 0.01, "substeps": 4, "sleeping_speed": 0.05}
    floor = {"kind": "plane", "point": [0.0, -0.06, 0.0]}
    scene = kinematic_scene("xpbd", bar=LOOSE | {"damping": 0.01}, gravity={}, method=method, floor=floor)
    expected = run(scene, 60, precision=precision, math="exact", threads=1)
    for kernel in ("graph", "launch", "stages"):
        state = run(scene, 60, "gpu", precision=precision, math="exact", kernel=kernel)
        assert np.array_equal(state.position, expected.position), kernel


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
