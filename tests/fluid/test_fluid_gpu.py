"""Fluids on a real GPU: the bits of the CPU in exact math, through launches, captured graphs and stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from flow_scenes import FLOWS
from fluid_scenes import in_a_cup
from small_fluids import few, flat, free, rich, stirred

from softlab.app.driver import open_simulation
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu
KERNELS = ("graph", "launch", "stages")
SCENES = {
    "rich": rich(),
    "flat": flat(),
    "averaged": flat(scheme="averaged"),
    "few": few(),
    "cup": in_a_cup(),
    "free rich": free(rich()),
    "free flat": flat(scheme="divergence-free"),
    "free many": few((1.0, 0.5, 0.75), scheme="divergence-free"),
    "many": few((1.0, 0.5, 0.75)),
}


def end_of(scene: Scene, backend: str, steps: int = 20, **options: Any) -> State:
    options = {"math": "exact", "initial": stirred(scene)} | options
    with open_simulation(scene, backend, **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


def same(a: State, b: State) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.velocity, b.velocity)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", SCENES)
def test_the_bits_are_the_cpus(name: str, precision: str) -> None:
    expected = end_of(SCENES[name], "cpu", precision=precision, threads=2)
    for kernel in KERNELS:
        assert same(end_of(SCENES[name], "gpu", precision=precision, kernel=kernel), expected), kernel


def test_runs_repeat_to_the_bit() -> None:
    """Cells are filled in whatever order threads come: no sum may show it, in fast math neither."""
    states = [end_of(SCENES["many"], "gpu", math="fast") for _ in range(3)]
    assert all(same(state, states[0]) for state in states)


def test_a_state_goes_on_and_positions_come_in_the_scenes_order() -> None:
    from numba import cuda

    scene = SCENES["many"]
    half = end_of(scene, "gpu", 10)
    with open_simulation(scene, "gpu", math="exact", initial=half) as simulation:
        simulation.advance(10)
        assert same(simulation.state(), end_of(scene, "gpu", 20))
        out = cuda.device_array((simulation.particle_count, 3), np.float32)
        simulation.read("position", into=out)
        assert np.array_equal(out.copy_to_host(), simulation.read("position"))


def test_a_particle_that_was_flung_away_costs_no_more_than_larger_cells() -> None:
    """A thousand metres away, where the table of cells cannot reach with cells of the support."""
    state = stirred(SCENES["few"])
    state.position[5] = 1000.0, 900.0, -800.0
    ends = [
        end_of(SCENES["few"], backend, 3, precision="float64", initial=state, **more)
        for backend, more in (("cpu", {"threads": 2}), ("gpu", {}))
    ]
    assert same(*ends) and np.isfinite(ends[0].position).all()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", FLOWS)
def test_what_comes_and_goes_has_the_cpus_bits(name: str, precision: str) -> None:
    """Launched, as a graph, stage by stage; who waits, and how many were missing; and the positions that are drawn."""
    from numba import cuda

    scene, ends = FLOWS[name](), []
    for backend, kernel in (("cpu", None), *(("gpu", one) for one in KERNELS)):
        with open_simulation(scene, backend, math="exact", precision=precision, kernel=kernel) as simulation:
            simulation.advance(20)
            ends.append((simulation.state(), simulation.not_emitted))  # type: ignore[attr-defined]
            if backend == "gpu":
                out = cuda.device_array(simulation.body.position.shape, np.float32)
                simulation.read("position", into=out)
                assert np.array_equal(out.copy_to_host(), ends[-1][0].position.astype(np.float32))
    for state, missing in ends[1:]:
        assert same(state, ends[0][0]) and missing == ends[0][1]
        assert np.array_equal(state.inverse_mass, ends[0][0].inverse_mass)
