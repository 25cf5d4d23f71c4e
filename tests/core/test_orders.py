"""Observed orders: the elastic pendulum (docs/method/cases.md A6), and the manufactured solution on the whole grid (A7)."""

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene, load_scene

# the pendulum's end at T = 1 by an order-8 integrator to 2e-14, against Newton's law and against half the acceleration
NEWTON = {0.0: (-0.596183852986, -0.898957849069), 0.03: (-0.087108010821, -1.022365327709)}
HALF = {0.0: (-0.305973032169, -0.894087872796), 0.03: (-0.031319545471, -0.977372662787)}
ACCEPTED = 0.1  # of an order, on each of the last two halvings


def pendulum(name: str, coefficient: float, steps: int) -> Scene:
    """An anchor and a mass on a spring: k 10, L0 1, m 0.01."""
    return Scene(
        {
            "grid": {"rows": 2, "columns": 1, "pinned": "top"},
            "springs": {},
            "gravity": {},
            "damping": {"coefficient": coefficient},
            "method": {"integrator": name, "dt": 1 / steps},
        }
    )


def last_two_orders(errors: list[float]) -> np.ndarray:
    return np.log2(np.array(errors[-3:-1]) / np.array(errors[-2:]))


def pendulum_errors(run, start_at, name, coefficient, counts, target, kernel="fused") -> list[float]:
    errors = []
    for steps in counts:
        scene = pendulum(name, coefficient, steps)
        state = run(
            scene, steps, kernel=kernel, initial=start_at(scene, [[0, 0], [0.6, -0.9]]), live=("damping", "gravity")
        )
        errors.append(float(np.hypot(*(state.position[1] - target[coefficient]))))
    return errors


HALVINGS = (400, 800, 1600, 3200)
SMALL = (6400, 12800, 25600)  # at larger steps explicit Euler's observed order is still 1.25, 1.12


@pytest.mark.parametrize("coefficient", [0.0, 0.03])
@pytest.mark.parametrize(
    ("name", "counts", "order"),
    [
        ("semi-implicit-euler", HALVINGS, 1),
        ("velocity-verlet", HALVINGS, 2),
        ("rk4", HALVINGS, 4),
        ("explicit-euler", SMALL, 1),
        ("taylor", SMALL, 1),
    ],
)
def test_order_of_each_integrator(run, start_at, name, counts, order, coefficient):
    """The declared order, with and without damping: velocity Verlet keeps 2 because its damper is implicit."""
    errors = pendulum_errors(run, start_at, name, coefficient, counts, NEWTON)
    assert np.abs(last_two_orders(errors) - order).max() < ACCEPTED
    assert INTEGRATORS[name].order == order


@pytest.mark.parametrize("coefficient", [0.0, 0.03])
def test_the_hand_outs_step_solves_another_equation(run, start_at, coefficient):
    """lab: order 0 against Newton's law (the error stays 0.29), order 1 against x'' = a / 2 (fact 1)."""
    newton = pendulum_errors(run, start_at, "lab", coefficient, HALVINGS, NEWTON)
    half = pendulum_errors(run, start_at, "lab", coefficient, HALVINGS, HALF)
    assert np.abs(last_two_orders(newton)).max() < ACCEPTED
    assert np.abs(last_two_orders(half) - 1).max() < ACCEPTED
    assert newton[-1] > 0.05
    if coefficient == 0:
        assert newton == pytest.approx([0.2886, 0.2894, 0.2898, 0.2900], abs=1e-4)
        assert half == pytest.approx([1.73e-3, 8.47e-4, 4.19e-4, 2.09e-4], rel=0.01)


@pytest.mark.parametrize(
    ("name", "coefficient", "printed"),
    [
        ("semi-implicit-euler", 0.0, [1.04e-3, 4.67e-4, 2.22e-4, 1.08e-4]),
        ("velocity-verlet", 0.0, [1.74e-4, 4.30e-5, 1.07e-5, 2.68e-6]),
        ("velocity-verlet", 0.03, [2.14e-5, 5.24e-6, 1.30e-6]),
        ("rk4", 0.0, [1.66e-7, 1.19e-8, 7.9e-10, 5.1e-11]),
    ],
)
def test_published_errors(run, start_at, name, coefficient, printed, kernel):
    """A6's table, to its printed digits (1 %; the last ones of RK4 to the reference's own 12 digits)."""
    counts = HALVINGS[: len(printed)] if kernel == "fused" else HALVINGS[:1]
    errors = pendulum_errors(run, start_at, name, coefficient, counts, NEWTON, kernel)
    assert errors == pytest.approx(printed[: len(counts)], rel=0.01, abs=2e-12)


def test_explicit_damping_costs_velocity_verlet_an_order():
    """A6: any velocity-dependent force, taken at the half step, silently makes the plain scheme first order."""
    errors = []
    for steps in HALVINGS:
        scene = pendulum("velocity-verlet", 0.03, steps)
        position, _ = reference.simulate(
            scene,
            steps,
            [[0, 0], [0.6, -0.9]],
            [[0, 0], [0, 0]],
            integrator=reference.EXPLICIT_DAMPING_VERLET,
        )
        errors.append(float(np.hypot(*(position[1] - NEWTON[0.03]))))
    assert np.abs(last_two_orders(errors) - 1).max() < ACCEPTED
    assert errors[0] == pytest.approx(1.65e-4, rel=0.01)
    assert errors[-1] == pytest.approx(1.74e-5, rel=0.01)


def manufactured_errors(run, name: str, counts, inertia: float = 1.0, kernel: str = "fused") -> list[float]:
    """max |p - p*| over masses and axes at T = 1."""
    errors = []
    for steps in counts:
        changes = {"method.integrator": name, "method.dt": 1 / steps, "manufactured.inertia": inertia}
        scene = load_scene("manufactured").replace(changes)
        exact = reference.manufactured_motion(scene, 1.0)[0].reshape(-1, 2)
        state = run(scene, steps, kernel=kernel)
        errors.append(float(np.abs(state.position - exact).max()))
    return errors


@pytest.mark.parametrize(
    ("name", "inertia", "order", "printed"),
    [
        ("semi-implicit-euler", 1, 1, [1.246e-2, 6.148e-3, 3.052e-3, 1.520e-3]),
        ("velocity-verlet", 1, 2, [1.528e-4, 3.822e-5, 9.557e-6, 2.389e-6]),
        ("rk4", 1, 4, [1.577e-7, 9.954e-9, 6.253e-10, 3.909e-11]),
        ("lab", 2, 1, [3.991e-3, 1.996e-3, 9.980e-4, 4.990e-4]),
        ("lab", 1, 0, [7.08e-2, None, None, 7.20e-2]),
    ],
)
def test_manufactured_solution(run, name, inertia, order, printed):
    """A7: every mass, every spring, every part of the force, on 8 x 8; orders, and the errors themselves to 1 %.

    lab: order 0 for the scene's own inertia, order 1 when the force is made for doubled masses.
    """
    errors = manufactured_errors(run, name, (100, 200, 400, 800), inertia)
    assert np.abs(last_two_orders(errors) - order).max() < ACCEPTED
    for error, value in zip(errors, printed, strict=True):
        assert value is None or error == pytest.approx(value, rel=0.01)


@pytest.mark.parametrize("name", ["explicit-euler", "taylor"])
def test_manufactured_solution_of_the_unstable_steps(run, name):
    """Order 1 once dt is under their limits of 3.75e-4 and 7.5e-4 s (stage by stage: no fused variant of their own)."""
    errors = manufactured_errors(run, name, (3200, 6400, 12800), kernel="stages")
    assert np.abs(last_two_orders(errors) - 1).max() < ACCEPTED


@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_manufactured_solution_stage_by_stage(run, name):
    """The unfused plan evaluates the force at the right stage times too: A7's errors at 100 steps."""
    printed = {"lab": 3.991e-3, "velocity-verlet": 1.528e-4, "rk4": 1.577e-7}[name]
    errors = manufactured_errors(run, name, (100,), 2.0 if name == "lab" else 1.0, "stages")
    assert errors == pytest.approx([printed], rel=0.01)


def test_the_manufactured_force_goes_on_where_dt_changes(opened, kernel):
    """Half of the time at 1/100 s, half at 1/200 s: no farther off than at 1/100 s all the while."""
    scene = load_scene("manufactured").replace({"method.integrator": "rk4", "method.dt": 0.01})
    exact = reference.manufactured_motion(scene, 1.0)[0].reshape(-1, 2)
    with opened(scene, kernel=kernel, live=("dt",)) as simulation:
        simulation.advance(50)
        simulation.set("method.dt", 0.005)
        simulation.advance(100)
        assert simulation.time == pytest.approx(1.0, rel=1e-12)
        assert np.abs(simulation.state().position - exact).max() < 1.577e-7


def test_reference_passes_its_own_test():
    """A7 for the NumPy reference: RK4 at 100 steps."""
    scene = load_scene("manufactured").replace({"method.integrator": "rk4", "method.dt": 0.01})
    position, _ = reference.simulate(scene, 100)
    exact = reference.manufactured_motion(scene, 1.0)[0].reshape(-1, 2)
    assert np.abs(position - exact).max() == pytest.approx(1.577e-7, rel=0.01)
