"""Implicit Euler's kernel under the simulator, one block: the CPU's bits, and as many matrices and iterations."""

from __future__ import annotations

import numpy as np
import pytest
from cloth_scenes import POKE, cloth_scene

from softlab.app.driver import open_simulation


@pytest.mark.parametrize(
    "name,integrator,precision",
    [("everything moving", "implicit-euler", "float64"), ("springs", "implicit-euler-linear", "float32")],
)
def test_exact_math_gives_the_bits_of_the_cpu(name: str, integrator: str, precision: str) -> None:
    scene = cloth_scene(name, integrator, rows=5, columns=6, pinned=[[0, 0], [3, 2]])
    states = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, precision=precision, math="exact", live=("poke", "dt")) as simulation:
            simulation.poke(*POKE)
            simulation.advance(1)
            simulation.set("method.dt", 2 * scene.method.dt)
            simulation.advance(1)
            states.append((simulation.state(), list(simulation.implicit.done)))
    (expected, done), (state, found) = states
    assert found == done and done[0] == 2
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
