"""Pins that follow a path on a real GPU: the CPU's bits in `exact` math, for every integrator and kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cloth_scenes import cloth_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import cloth as reference_cloth
from softlab.model.core.build import build
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu
STEPS = 300


def end_state(scene: Scene, backend: str, steps: int = STEPS, **options: Any) -> State:
    """After so many steps; after a third of them the state is read and loaded, after two thirds dt is changed."""
    options = {"math": "exact", "live": ("dt",), "allow_unstable": True} | options
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps // 3)
        simulation.load(simulation.state())
        simulation.advance(steps // 3)
        simulation.set("method.dt", 0.75 * scene.method.dt)
        simulation.advance(steps - 2 * (steps // 3))
        return simulation.state()


def assert_same(state: State, expected: State, what: object) -> None:
    assert np.array_equal(state.position, expected.position), what
    assert np.array_equal(state.velocity, expected.velocity), what


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("name", ["moving", "everything moving"])
def test_exact_math_gives_the_bits_of_the_cpu(name: str, integrator: str, precision: str) -> None:
    for rows, columns, kernels in ((37, 45, ("graph", "launch")), (29, 31, ("one-block", "stages"))):
        scene = cloth_scene(name, integrator, rows=rows, columns=columns)
        if integrator in ("explicit-euler", "taylor"):  # unstable from small steps on
            scene = scene.replace({"method.dt": 1e-5})
        expected = end_state(scene, "cpu", precision=precision)
        for kernel in kernels:
            if (kernel, integrator) != ("one-block", "rk4"):
                state = end_state(scene, "gpu", precision=precision, kernel=kernel)
                assert_same(state, expected, (kernel, rows, columns))


def test_the_twisted_sheet_gives_the_bits_of_the_cpu() -> None:
    scene = load_scene("cloth-twist")
    assert_same(end_state(scene, "gpu", 600, kernel="graph"), end_state(scene, "cpu", 600), "graph")


@pytest.mark.parametrize("kernel", ["graph", "launch", "stages"])
def test_pins_are_where_their_motion_has_them_in_fast_math(kernel: str) -> None:
    """To rounding: of the time two units in the last place, of seconds and turns one each, over a radius of 0.7 m; and some
    eight of sums of coordinates up to 2.4 m."""
    scene = load_scene("cloth-twist")
    pinned, dt = build(scene).pinned, scene.method.dt
    with open_simulation(scene, "gpu", math="fast", kernel=kernel) as simulation:
        simulation.advance(500)
        position = simulation.state().position
    still = np.zeros((scene.grid.rows, scene.grid.columns, 3))
    expected, _ = reference_cloth.follow(scene, reference_cloth.rest(scene), still, 500 * dt)
    motion = next(iter(scene.motions.values()))
    angle = abs(motion.angular_velocity) * min(500 * dt, motion.duration)
    bound = np.finfo(np.float32).eps * (0.7 * (5 * angle + 8) + 8 * 2.4)
    assert np.abs(position[pinned] - expected.reshape(-1, 3)[pinned]).max() < bound


def test_passes_with_motions_spill_nothing() -> None:
    with open_simulation(
        cloth_scene("everything moving", "velocity-verlet", rows=40, columns=40), "gpu", allow_unstable=True
    ) as simulation:
        for kernel in simulation._passes.values():
            for compiled in kernel.overloads.values():
                assert compiled.local_mem_per_thread == 0
