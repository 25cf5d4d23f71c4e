"""Newton's method of second order in time (model/formulas/elastic/stages.py): the judge's steps, its order, what it takes
from a swing, what it refuses."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from kinematic_scenes import BAR, CUBE, HOOK, kinematic_scene
from newton_scenes import bar, newton_scene, shaken
from tetrahedra_scenes import BODY

from softlab.app.driver import open_simulation
from softlab.bench.experiments.tetrahedral.meshes import decay, law, swinging
from softlab.bench.reference import tetrahedra_newton as reference
from softlab.model.base.errors import SceneError, UnstableTimeStep
from softlab.model.core.simulation import State
from softlab.model.formulas.elastic.stages import STAGE
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.newton import newton_record, solved

NAMES = ["fixed-corotated", "corotated", "neo-hookean", "damped"]


def second(scene: Scene, **changes: int | float) -> Scene:
    """The same at order 2, and those fields of its method."""
    return scene.replace({"method.order": 2} | {f"method.{name}": value for name, value in changes.items()})


@pytest.mark.parametrize("name", NAMES)
def test_steps_are_the_judges(name: str) -> None:
    """As of order 1 (test_newton.py), of four solves."""
    scene = second(newton_scene(name), iterations=30)
    start = shaken(scene)
    with open_simulation(scene, precision="float64", math="exact", initial=start) as simulation:
        simulation.advance(2)
        got = simulation.state()
    want = reference.simulate(scene, 2, start.position, start.velocity)
    moved = np.abs(want[0] - start.position).max()
    assert moved > 1e-3
    np.testing.assert_allclose(got.position, want[0], atol=1e-6 * moved)


def ends(order: int, substeps: int) -> np.ndarray:
    """Where a bar that bends far is after a fifth of its swing."""
    scene = bar(1, young_modulus=1e5).replace(
        {"method.order": order, "method.substeps": substeps, "method.iterations": 40, "method.dt": 0.25}
    )
    with open_simulation(scene, precision="float64", math="exact") as simulation:
        simulation.advance(1)
        return simulation.read("position")


def test_orders_are_first_and_second() -> None:
    """Errors over substeps that halve, against 512 of order 2: of large turns, solved to the end."""
    exact = ends(2, 512)
    for order, least, most in ((1, 0.85, 1.1), (2, 1.8, 2.2)):
        errors = [np.abs(ends(order, n) - exact).max() for n in (32, 64, 128)]
        found = np.log2(np.array(errors[:-1]) / errors[1:])
        assert (found > least).all() and (found < most).all(), (order, found)


def test_a_swing_loses_what_the_stages_take() -> None:
    """Of the amplitude a second, by the law; of bars so stiff that it is more than what is left to solve."""
    for young in (1e8, 4e8):
        found = decay(swinging("newton order 2", 1, 1).replace({"beam.young_modulus": young}), "cpu")
        expected, _, lost = (
            found[name][0] for name in ("tetrahedra_decay_law", "tetrahedra_swing", "tetrahedra_decay")
        )
        assert expected is not None and lost == pytest.approx(expected, rel=0.02)


def test_the_law_is_of_third_order() -> None:
    """-log |R(iz)| / h of the stability function, R(z) = (1 + (1 - 2 g) z) / (1 - g z)^2, whose error begins with z^3."""
    for h in (0.1, 0.01):
        z = 2j * pi * h
        by_hand = (1 + (1 - 2 * STAGE) * z) / (1 - STAGE * z) ** 2
        assert law(1.0, h, 2) == pytest.approx(-np.log(abs(by_hand)) / h)
    assert law(1.0, 1e-3, 2) / law(1.0, 5e-4, 2) == pytest.approx(8, rel=1e-3)
    assert law(1.0, 1e-3, 2) < 1e-4 * law(1.0, 1e-3)


def test_a_bar_within_a_hundredth_in_one_substep_a_frame() -> None:
    """NUMERICS E2: half a vibration at 1e7 Pa, by two solves a frame, where order 1 is off by a tenth."""
    from softlab.bench.experiments.tetrahedra import drop, let_go
    from softlab.bench.experiments.tetrahedral.cantilever import cantilever, exact_drop

    off = {}
    for solver in ("newton", "newton order 2"):
        with open_simulation(let_go(cantilever(2, 1e7, solver, 1, 1)), precision="float64") as simulation:
            off[solver] = drop(simulation, 2, 1e7) / exact_drop(2, 1e7)[1] - 1
    assert abs(off["newton order 2"]) < 0.01 < 0.1 < abs(off["newton"])


def everything() -> Scene:
    """Two bodies with dampers of all kinds, one hung up by springs, a force that changes with the step."""
    scene = kinematic_scene(
        "newton", bar=BAR | {"edge": 0.1, "damping": 0.03, "mass_damping": 3.0}, cube=CUBE | {"edge": 0.1}, hook=HOOK,
        gravity={}, external={"magnitude": 0.5},
    )  # fmt: skip
    return second(scene, substeps=3)


def test_a_run_in_parts_is_the_same() -> None:
    """A step begins at its first stage, whatever was called before; another step size and a push are of both stages."""
    scene, states = everything(), []
    for parts in ((3,), (1, 2)):
        with open_simulation(scene, math="exact", live=("dt", "poke"), initial=shaken(scene)) as simulation:
            for steps in parts:
                simulation.advance(steps)
            simulation.set("method.dt", 0.5 * scene.method.dt)
            simulation.poke(3, (1.0, 0.0, 0.0))
            simulation.advance(1)
            states.append(simulation.state())
    for one in states[1:]:
        assert np.array_equal(one.position, states[0].position) and np.array_equal(one.velocity, states[0].velocity)


def test_a_body_that_is_braked_slows_as_the_stages_say() -> None:
    """By R(z) = 1 - z + g (1 - g) z^2 a substep, z = h c, of the rate at which its own velocities decay."""
    rate, h = 5.0, 0.02
    scene = second(newton_scene("fixed-corotated", body=BODY | {"pinned": [], "mass_damping": rate}), substeps=1)
    scene = scene.replace({"method.dt": h, "gravity.enabled": False})
    with open_simulation(scene, precision="float64", math="exact") as simulation:
        begin = simulation.state()
        velocity = np.broadcast_to([0.5, 1.0, -0.2], begin.position.shape)
        simulation.load(State(begin.position, velocity, begin.inverse_mass, 0.0, 0))
        simulation.advance(4)
        found = simulation.state().velocity
    z = rate * h
    np.testing.assert_allclose(found, (1 - z + STAGE * (1 - STAGE) * z**2) ** 4 * velocity, rtol=1e-9)


def test_the_limit_is_that_of_two_stages() -> None:
    """A body that is braked by its rate c holds to h c = 1 / (g (1 - g)), 4.83, and not beyond."""
    body = BODY | {"pinned": [], "mass_damping": 100.0}
    scene = second(newton_scene("fixed-corotated", body=body), substeps=1, dt=0.0482)
    edge = 1 / (STAGE * (1 - STAGE)) / 100.0
    speeds = []
    for h in (0.98 * edge, 1.02 * edge):
        one = scene.replace({"method.dt": h, "gravity.enabled": False})
        with open_simulation(one, precision="float64", allow_unstable=True) as simulation:
            assert simulation.limit == pytest.approx(edge)
            begin = simulation.state()
            velocity = np.broadcast_to([0.5, 1.0, -0.2], begin.position.shape)
            simulation.load(State(begin.position, velocity, begin.inverse_mass, 0.0, 0))
            simulation.advance(10)
            speeds.append(np.abs(simulation.state().velocity).max())
    assert speeds[0] < 1 < speeds[1]
    with pytest.raises(UnstableTimeStep):
        open_simulation(scene.replace({"method.dt": 1.02 * edge}))


def test_its_mesh_is_cut_once() -> None:
    """The constants of a solve are asked for at every push: none of them makes a body anew."""
    scene = second(newton_scene("damped"))
    assert solved(scene).tetrahedra_set is scene.tetrahedra_set and solved(scene).grid is scene.grid
    assert solved(scene).method.dt == pytest.approx(STAGE * scene.method.dt) and scene.method.dt == 0.01
    with pytest.raises(SceneError, match="1e-44"):  # what was given is told, and not what a stage takes
        newton_record(scene.replace({"method.dt": 1e-44}), np.float32)
