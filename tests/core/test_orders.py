"""Observed orders: the elastic pendulum (docs/method/cases.md A6), and the linear lattice, every mass and spring (A7)."""

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene

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


SIDE, K, MASS, GRAVITY, DAMPER = 8, 10.0, 0.01, 9.81, 0.03  # masses, N/m, kg, m/s^2, N s/m


def lattice(name: str, steps: int) -> Scene:
    """Free masses between springs of zero rest length, off their rest positions, with gravity and damping."""
    return Scene(
        {
            "grid": {"rows": SIDE, "columns": SIDE, "mass": MASS, "pinned": "none"},
            "springs": {"stiffness": K, "rest_length": 0.0},
            "gravity": {"acceleration": GRAVITY},
            "damping": {"coefficient": DAMPER},
            "perturbation": {"amplitude": 0.1},
            "method": {"integrator": name, "dt": 1 / steps},
        }
    )


def lattice_motion(scene: Scene, inertia: float) -> np.ndarray:
    """Positions at T = 1 (particles, 2) [m], exact. Springs of zero rest length are linear, so that the modes of the free
    lattice, cos(p pi (i + 1/2) / N) along a side, move apart: with w^2 = (4 k / m) [sin^2(p pi / 2N) + sin^2(q pi / 2N)]
    and the rate g = c / m a mode decays as exp(-g t / 2) (cos(v t) + g sin(v t) / 2v), v^2 = w^2 - g^2 / 4; their mean
    falls by a (t / g - (1 - exp(-g t)) / g^2). `inertia` times the mass."""
    number, rate = np.arange(SIDE), DAMPER / (inertia * MASS)
    along = np.cos(np.pi * number[:, None] * (number + 0.5) / SIDE)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = 4 * K / (inertia * MASS) * np.sin(np.pi * number / (2 * SIDE)) ** 2
    squared = side[:, None] + side
    v = np.emath.sqrt(squared - rate**2 / 4).astype(complex)
    decay = (np.exp(-rate / 2) * (np.cos(v) + rate / 2 * np.sin(v) / v)).real
    start = reference.start(scene)[0].reshape(SIDE, SIDE, 2)
    modes = np.einsum("pi,qj,ijd->pqd", along, along, start) * decay[..., None]
    end = np.einsum("pi,qj,pqd->ijd", along, along, modes)
    end[..., 1] -= GRAVITY / inertia * (1 / rate - (1 - np.exp(-rate)) / rate**2)
    return end.reshape(-1, 2)


def lattice_errors(run, name: str, counts, inertia: float = 1.0, kernel: str = "fused") -> list[float]:
    """max |p - exact p| over masses and axes at T = 1."""
    errors = []
    for steps in counts:
        scene = lattice(name, steps)
        state = run(scene, steps, kernel=kernel)
        errors.append(float(np.abs(state.position - lattice_motion(scene, inertia)).max()))
    return errors


@pytest.mark.parametrize(
    ("name", "inertia", "order"),
    [("semi-implicit-euler", 1, 1), ("velocity-verlet", 1, 2), ("rk4", 1, 4), ("lab", 2, 1), ("lab", 1, 0)],
)
def test_linear_lattice(run, name, inertia, order):
    """A7: every mass, every spring, gravity and damping, on 8 x 8: the orders.

    lab: order 0 for the scene's own inertia, order 1 for doubled masses, as which it moves.
    """
    errors = lattice_errors(run, name, HALVINGS, inertia)
    assert np.abs(last_two_orders(errors) - order).max() < ACCEPTED


@pytest.mark.parametrize("name", ["explicit-euler", "taylor"])
def test_linear_lattice_of_the_unstable_steps(run, name):
    """Order 1 once dt is under their limits of 3.75e-4 and 7.5e-4 s (stage by stage: no fused variant of their own)."""
    errors = lattice_errors(run, name, SMALL, kernel="stages")
    assert np.abs(last_two_orders(errors) - 1).max() < ACCEPTED


@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_linear_lattice_stage_by_stage(run, name):
    """The unfused plan has the errors of the fused kernels, to rounding."""
    inertia = 2.0 if name == "lab" else 1.0
    fused, stages = (lattice_errors(run, name, HALVINGS[:1], inertia, kernel) for kernel in ("fused", "stages"))
    assert stages == pytest.approx(fused, rel=1e-6)


def test_the_orders_go_on_where_dt_changes(opened, kernel):
    """Half of the time at 1/400 s, half at 1/800 s: no farther off than at 1/400 s all the while, farther than at 1/800 s."""
    ends = []
    for first, second in ((400, 400), (400, 800), (800, 800)):
        scene = lattice("rk4", first)
        with opened(scene, kernel=kernel, live=("dt",)) as simulation:
            simulation.advance(first // 2)
            simulation.set("method.dt", 1 / second)
            simulation.advance(second // 2)
            assert simulation.time == pytest.approx(1.0, rel=1e-12)
            ends.append(np.abs(simulation.state().position - lattice_motion(scene, 1.0)).max())
    assert ends[0] > ends[1] > ends[2]


def test_reference_passes_its_own_test():
    """A7 for the NumPy reference: the order of RK4."""
    errors = []
    for steps in HALVINGS[:3]:
        scene = lattice("rk4", steps)
        errors.append(float(np.abs(reference.simulate(scene, steps)[0] - lattice_motion(scene, 1.0)).max()))
    assert np.abs(last_two_orders(errors) - 4).max() < ACCEPTED
