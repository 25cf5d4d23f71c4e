"""The cloth's CUDA kernels, in plain Python: stage by stage, in one pass and in one block to the same bits, and to the
independent NumPy reference within rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cloth_scenes import BODIES, PARTS, POKE, cloth_scene

from softlab.app.driver import open_simulation
from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

STEPS = 2


def end_state(scene: Scene, kernel: str, live: tuple[str, ...] = ("poke",), **options: Any) -> State:
    with open_simulation(
        scene, "gpu", math="exact", kernel=kernel, live=live, allow_unstable=True, **options
    ) as simulation:
        if live:
            simulation.poke(*POKE)
        simulation.advance(STEPS - 1)
        simulation.advance(1)
        return simulation.state()


def same(one: State, other: State) -> bool:
    return np.array_equal(one.position, other.position) and np.array_equal(one.velocity, other.velocity)


@pytest.mark.parametrize("integrator", ["velocity-verlet", "lab", "rk4"])
def test_stages_passes_and_one_block_give_the_same_bits(integrator: str) -> None:
    scene = cloth_scene("everything", integrator)
    state = end_state(scene, "launch")
    assert same(state, end_state(scene, "stages"))
    if integrator != "rk4":
        assert same(state, end_state(scene, "one-block"))


@pytest.mark.parametrize("name", ["springs", "random", "bodies", "bare"])
def test_kicks_that_meet_give_the_same_bits(name: str) -> None:
    """No force depends on velocities there: velocity Verlet's two kicks between steps are one pass."""
    scene = cloth_scene(name, "velocity-verlet") if name != "bare" else Scene(PARTS["bare"])
    state = end_state(scene, "launch", precision="float64")
    assert same(state, end_state(scene, "stages", precision="float64"))
    assert same(state, end_state(scene, "one-block", precision="float64"))


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("bodies", [True, False], ids=["bodies", "free"])
def test_the_reference_is_met_within_rounding(bodies: bool, integrator: str) -> None:
    """A step's some hundred roundings are of numbers up to the fastest mass's velocity, and steps add them up.

    One step with bodies: from then on masses lie on them, and a rounding decides whether they touch."""
    data = {name: table for name, table in PARTS["everything"].items() if bodies or name not in BODIES}
    scene = Scene(data | {"method": data["method"] | {"integrator": integrator}})
    steps = 1 if bodies else STEPS
    position, velocity = reference.simulate(scene, steps)
    with open_simulation(
        scene, "gpu", math="exact", kernel="launch", precision="float64", allow_unstable=True
    ) as simulation:
        simulation.advance(steps)
        state = simulation.state()
    bound = steps * 100 * np.finfo(np.float64).eps * max(1.0, float(np.abs(velocity).max()))
    assert np.abs(state.position - position).max() < bound
    assert np.abs(state.velocity - velocity).max() < bound / scene.method.dt


@pytest.mark.parametrize("body", BODIES)
def test_every_body_is_met(body: str) -> None:
    """Else the tests above would say nothing about it."""
    tables = {name: table for name, table in PARTS["bodies"].items() if name not in BODIES}
    alone, with_body = Scene(tables), Scene(tables | {body: BODIES[body]})
    assert not same(end_state(alone, "one-block"), end_state(with_body, "one-block"))


@pytest.mark.parametrize("rows,columns", [(1, 1), (1, 5), (4, 1), (2, 2)])
def test_the_smallest_sheets(rows: int, columns: int) -> None:
    data = PARTS["air"] | {"cloth": {"rows": rows, "columns": columns, "spacing": 0.1}}
    scene = Scene(data)
    state = end_state(scene, "launch", live=(), precision="float64")
    position, _ = reference.simulate(scene, STEPS)
    assert np.abs(state.position - position).max() < STEPS * 100 * np.finfo(np.float64).eps
    assert same(state, end_state(scene, "one-block", live=(), precision="float64"))


def test_normals_are_those_of_the_triangles() -> None:
    """The mean of the up to six triangles' normals, weighted by area: summed here triangle by triangle."""
    scene = cloth_scene("springs", "velocity-verlet")
    rows, columns = scene.grid.rows, scene.grid.columns
    with open_simulation(scene, "gpu", math="exact", precision="float64") as simulation:
        p = simulation.read("position").reshape(rows, columns, 3)
        found = simulation.read("normal")
        target = np.zeros_like(found)
        assert simulation.read("normal", into=target) is target and np.array_equal(target, found)
    total = np.zeros_like(p)
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b, c, d = (i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)
            for corners in ((a, c, d), (a, d, b)):
                normal = np.cross(p[corners[1]] - p[corners[0]], p[corners[2]] - p[corners[0]])
                for corner in corners:
                    total[corner] += normal
    expected = (total / np.linalg.norm(total, axis=2, keepdims=True)).reshape(-1, 3)
    assert np.abs(found - expected).max() < 20 * np.finfo(np.float64).eps  # six products and sums, of the order of 1


def test_a_divergence_is_named_and_the_state_stays_finite() -> None:
    scene = cloth_scene("springs", "velocity-verlet", rows=3, columns=3, pinned="none").replace({"method.dt": 1.0})
    with open_simulation(scene, "gpu", math="exact", allow_unstable=True) as simulation:
        with pytest.raises(Diverged):
            simulation.advance(16)
            simulation.check()
        assert np.isfinite(simulation.state().position).all()


def test_live_changes_and_a_rewind() -> None:
    scene = cloth_scene("springs", "lab", rows=4, columns=4, pinned="top")
    with open_simulation(scene, "gpu", math="exact", live=("gravity",)) as simulation:
        simulation.advance(2)
        before = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(2)
        still = simulation.state()
        simulation.load(before)
        simulation.set("gravity.enabled", True)
        simulation.advance(2)
        falling = simulation.state()
    change = falling.velocity - still.velocity
    lowest = change.reshape(4, 4, 3)[3, 1]
    assert lowest[1] < 0 and falling.velocity[:4].max() == 0


@pytest.mark.parametrize(
    "kernel,integrator,what",
    [("graph", "lab", "simulator"), ("one-block", "rk4", "rk4"), ("blocks", "lab", "one-block")],
)
def test_a_kernel_that_cannot_run_is_refused_with_the_reason(kernel: str, integrator: str, what: str) -> None:
    with pytest.raises(SceneError, match=what):
        open_simulation(cloth_scene("springs", integrator), "gpu", kernel=kernel)
    with pytest.raises(SceneError, match="at most 1024"):
        open_simulation(cloth_scene("springs", "lab", rows=40, columns=40), "gpu", kernel="one-block")
