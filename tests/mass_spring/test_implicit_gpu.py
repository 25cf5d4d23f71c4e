"""Implicit Euler on a real GPU: whole steps a launch, blocks that meet at a barrier, and the CPU's bits in `exact` math."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cloth_scenes import POKE, cloth_scene

from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
STEPS = 70  # more than one launch does


def end_state(scene: Scene, backend: str, steps: int = STEPS, **options: Any) -> tuple[State, list[int]]:
    with open_simulation(scene, backend, live=("poke", "dt"), **({"math": "exact"} | options)) as simulation:
        simulation.poke(*POKE)
        simulation.advance(steps - 3)
        simulation.set("method.dt", 2 * scene.method.dt)
        simulation.advance(3)
        return simulation.state(), list(simulation.implicit.done)


@pytest.mark.parametrize(
    "name,integrator,precision",
    [
        ("everything", "implicit-euler", "float32"),
        ("damped", "implicit-euler", "float64"),
        ("springs", "implicit-euler-linear", "float32"),
        ("everything moving", "implicit-euler", "float64"),
    ],
)
def test_exact_math_gives_the_bits_of_the_cpu(name: str, integrator: str, precision: str) -> None:
    """And as many matrices and iterations: on sheets of one block, of many, and of rows of several segments."""
    for rows, columns in ((7, 6), (37, 45), (5, 530), (200, 4)):
        scene = cloth_scene(name, integrator, rows=rows, columns=columns)
        expected, done = end_state(scene, "cpu", precision=precision)
        state, found = end_state(scene, "gpu", precision=precision)
        assert found == done, (rows, columns)
        assert np.array_equal(state.position, expected.position), (rows, columns)
        assert np.array_equal(state.velocity, expected.velocity), (rows, columns)


def test_the_hanging_cloth_at_a_large_step_gives_the_bits_of_the_cpu() -> None:
    scene = load_scene("cloth-hanging").replace({"method.integrator": "implicit-euler", "method.dt": 0.02})
    scene = scene.replace({"structural.stiffness": 1e4, "shear.stiffness": 1e4})
    states = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, math="exact") as simulation:
            simulation.advance(50)
            states.append((simulation.state(), list(simulation.implicit.done)))
    assert states[0][1] == states[1][1]
    assert np.array_equal(states[0][0].position, states[1][0].position)


def test_fast_math_stays_near_exact() -> None:
    """A Newton step is solved to some part of 1e-2 in both, and what is left then differs: of velocities, by as much as the
    last residual, 1e-8 of the first, which is v + dt a < 10 m/s a mass; 70 steps, in a damped cloth, add up."""
    scene = cloth_scene("springs", "implicit-euler", rows=20, columns=22)
    exact, _ = end_state(scene, "gpu", precision="float64")
    fast, _ = end_state(scene, "gpu", precision="float64", math="fast")
    bound = STEPS * 1e-8 * 10 * (20 * 22) ** 0.5
    assert 0 < np.abs(fast.velocity - exact.velocity).max() < bound


def test_another_kernel_is_refused() -> None:
    with pytest.raises(SceneError, match="cooperative"):
        open_simulation(cloth_scene("springs", "implicit-euler"), "gpu", kernel="graph")
