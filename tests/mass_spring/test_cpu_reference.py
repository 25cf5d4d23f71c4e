"""Both backends against the NumPy reference: every integrator, every part, live changes, odd grids, S1 and S2."""

from dataclasses import replace

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.core.integrators import INTEGRATORS, frequency_bound
from softlab.model.scene.scene import Scene, load_scene

NAMES = list(INTEGRATORS)
EPSILON = {"float64": 2.0**-53, "float32": 2.0**-24}
PARTS = {  # every part at once: one compiled variant an integrator, shared with tests/core/test_cpu_bits.py
    "grid.rows": 11,
    "grid.columns": 13,
    "external.magnitude": 0.05,
    "external.seed": 2**40 + 7,
}


def everything(name: str) -> Scene:
    """S2 with a random force; explicit Euler and taylor at a step size they hold to."""
    dt = 0.0003 if name in ("explicit-euler", "taylor") else 0.01
    return load_scene("lab-hammock").replace(PARTS | {"method.integrator": name, "method.dt": dt})


def allowed(scene: Scene, steps: int, precision: str) -> tuple[float, float]:
    """(position [m], velocity [m/s]) that rounding may differ by after `steps` steps.

    A step rounds p a few times by eps |p| (4 covers RK4's sums), a force by eps k |p| / m. Damped scenes contract
    (docs/method/cases.md, fact 5), so errors add at most: 4 n eps |p|. A rounded force moves the velocity by dt w^2 eps |p|
    a step, and the hand-out's division of positions by dt by eps |p| / dt: both are under eps |p| (dt w^2 + 1 / dt).
    """
    size = max(scene.grid.rows, scene.grid.columns) * 1.5 * scene.grid.spacing
    position = 4 * steps * EPSILON[precision] * size
    dt = scene.method.dt
    return position, position * (dt * frequency_bound(scene) ** 2 + 1 / dt)


def assert_close(state, expected, scene, steps, precision):
    position, velocity = allowed(scene, steps, precision)
    assert np.abs(state.position - expected[0]).max() < position
    assert np.abs(state.velocity - expected[1]).max() < velocity


@pytest.mark.parametrize("name", NAMES)
def test_integrators_over_200_steps(run, name, precision, kernel):
    """All parts at once: springs, damper, gravity, random force, pins; tolerance from the rounding of 200 steps."""
    scene = everything(name)
    state = run(scene, 200, kernel=kernel, precision=precision, live=("poke",))
    assert_close(state, reference.simulate(scene, 200), scene, 200, precision)


def test_each_kick_takes_the_random_force_of_its_own_step_and_pins_stay_at_rest(opened):
    """Velocity Verlet's two kicks between steps are one pass, in which the first belongs to the step before. A pinned mass
    that was given a velocity has none after a step."""
    scene = everything("velocity-verlet")
    for kernel in ("fused", "stages"):
        with opened(scene, kernel=kernel, live=("poke",)) as simulation:
            start = simulation.state()
            pinned = start.inverse_mass == 0
            assert pinned.any()
            simulation.load(replace(start, velocity=np.where(pinned[:, None], 3.0, start.velocity)))
            simulation.advance(5)
            state = simulation.state()
        assert_close(state, reference.simulate(scene, 5), scene, 5, "float64")
        assert not state.velocity[pinned].any() and np.array_equal(state.position[pinned], start.position[pinned])


@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_live_changes(opened, name, kernel):
    """Gravity off and on, another dt and stiffness, another damper, a poke held and let go, under a random force: each
    segment against the reference continued with the changed scene."""
    scene = everything(name)
    segments = [
        ({}, None, 20),
        ({"gravity.enabled": False}, None, 15),
        ({"springs.stiffness": 25.0}, (17, (0.3, 0.4)), 20),
        ({"method.dt": 0.004, "gravity.enabled": True}, (17, (0.3, 0.4)), 25),
        ({"damping.coefficient": 0.01, "gravity.acceleration": 3.0}, None, 20),
        ({}, (0, (1.0, 1.0)), 5),  # a pinned mass feels nothing
    ]
    expected: tuple = (None, None)
    done = 0
    with opened(scene, kernel=kernel, live=("gravity", "dt", "stiffness", "damping", "poke")) as simulation:
        for changes, poke, steps in segments:
            for path, value in changes.items():
                simulation.set(path, value)
            simulation.poke(*(poke or (None,)))
            simulation.advance(steps)
            scene = scene.replace(changes)
            expected = reference.simulate(scene, steps, *expected, first_step=done, poke=poke)
            done += steps
            state = simulation.state()
            assert_close(state, expected, scene, done, "float64")
        assert simulation.step == done
        assert simulation.time == pytest.approx(55 * 0.01 + 50 * 0.004)


@pytest.mark.parametrize(("rows", "columns", "pinned"), [(1, 1, "none"), (1, 9, "none"), (9, 1, "none")])
@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_odd_grids_free(run, name, rows, columns, pinned, kernel):
    """B24: one mass, a row, a column: no neighbour is made up at the edges."""
    changes = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": pinned, "method.integrator": name}
    scene = load_scene("lab-hammock").replace(changes)
    state = run(scene, 50, kernel=kernel, live=("damping", "gravity"), threads=2)
    assert_close(state, reference.simulate(scene, 50), scene.replace({"grid.rows": 12}), 50, "float64")


@pytest.mark.parametrize(
    ("rows", "columns", "pinned"),
    [
        (1, 1, "top"),
        (1, 9, "top-corners"),
        (9, 1, "top"),
        (2, 7, "edges"),
        (1, 9, "every:3"),
        (5, 4, [[0, 0], [4, 3], [0, 0]]),
        (3, 3, [[row, column] for row in range(3) for column in range(3)]),
    ],
)
@pytest.mark.parametrize("name", ["lab", "velocity-verlet", "rk4"])
def test_odd_grids_pinned(run, name, rows, columns, pinned, kernel):
    """B24 with pins, all masses pinned included: pinned masses are bit for bit where they were, with velocity 0."""
    changes = {"grid.rows": rows, "grid.columns": columns, "grid.pinned": pinned, "method.integrator": name}
    scene = load_scene("lab-hammock").replace(changes)
    state = run(scene, 50, kernel=kernel, live=("damping", "gravity"), threads=2)
    assert_close(state, reference.simulate(scene, 50), scene.replace({"grid.rows": 12}), 50, "float64")
    held = reference.pinned_mask(scene).ravel()
    assert np.array_equal(state.position[held], reference.start(scene)[0][held])
    assert np.all(state.velocity[held] == 0)


@pytest.fixture(scope="module")
def converged_scenes():
    """{name: (against Newton's law, against half the acceleration)} at 1.5 s."""
    return {
        name: [reference.converged(load_scene(name), 1.5, inertia=inertia, tolerance=1e-7)[0] for inertia in (1.0, 2.0)]
        for name in ("lab-curtain", "lab-hammock")
    }


# RMS error [m] over all masses at 1.5 s (docs/method/cases.md C): scene, integrator -> {dt [s]: error};
# `half`: against half the acceleration
PUBLISHED = {
    ("lab-curtain", "lab"): {0.02: 0.2919, 0.01: 0.3052, 0.005: 0.3120, 0.0025: 0.3153},
    ("lab-curtain", "lab, half"): {0.02: 2.76e-2, 0.01: 1.38e-2, 0.005: 6.86e-3, 0.0025: 3.43e-3},
    ("lab-curtain", "semi-implicit-euler"): {0.02: 1.915e-2, 0.01: 9.65e-3, 0.005: 4.83e-3, 0.0025: 2.42e-3},
    ("lab-curtain", "velocity-verlet"): {0.02: 1.93e-3, 0.01: 5.29e-4, 0.005: 1.31e-4, 0.0025: 3.28e-5},
    ("lab-curtain", "rk4"): {0.02: 2.40e-4, 0.01: 2.08e-5, 0.005: 1.24e-6, 0.0025: 7.6e-8},
    ("lab-hammock", "lab"): {0.02: 0.7530, 0.01: 0.7771, 0.0025: 0.7951},
    ("lab-hammock", "lab, half"): {0.02: 4.84e-2, 0.01: 2.41e-2, 0.0025: 6.01e-3},
    ("lab-hammock", "semi-implicit-euler"): {0.02: 5.70e-2, 0.01: 2.85e-2, 0.0025: 7.11e-3},
    ("lab-hammock", "velocity-verlet"): {0.02: 1.67e-3, 0.01: 4.67e-4, 0.0025: 2.87e-5},
    ("lab-hammock", "rk4"): {0.02: 1.98e-4, 0.01: 1.70e-5, 0.0025: 6.3e-8},
}
EXPLICIT_DAMPER = {
    "lab-curtain": {0.02: 4.36e-3, 0.01: 1.94e-3, 0.005: 9.05e-4, 0.0025: 4.39e-4},
    "lab-hammock": {0.02: 1.41e-2, 0.01: 6.95e-3, 0.0025: 1.72e-3},
}


def rms(position: np.ndarray, target: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum((position - target) ** 2, axis=1))))


@pytest.mark.parametrize(
    ("scene_name", "name", "dt"),
    [(scene, name, dt) for (scene, name), table in PUBLISHED.items() if "half" not in name for dt in table],
)
def test_published_errors_of_s1_and_s2(run, converged_scenes, scene_name, name, dt):
    """docs/method/cases.md C, the whole table: within 2 % in float64. lab is off by 0.3 m at any step size, and converges, at
    first order, to half the acceleration."""
    scene = load_scene(scene_name).replace({"method.integrator": name, "method.dt": dt})
    state = run(scene, round(1.5 / dt))
    newton, half = (rms(state.position, target) for target in converged_scenes[scene_name])
    assert newton == pytest.approx(PUBLISHED[scene_name, name][dt], rel=0.02)
    if name == "lab":
        assert half == pytest.approx(PUBLISHED[scene_name, "lab, half"][dt], rel=0.02)


@pytest.mark.parametrize(
    ("scene_name", "dt"), [(scene, dt) for scene, table in EXPLICIT_DAMPER.items() for dt in table]
)
def test_published_errors_of_an_explicit_damper(converged_scenes, scene_name, dt):
    """docs/method/cases.md C: velocity Verlet with the damper taken explicitly, which only the reference has."""
    scene = load_scene(scene_name).replace({"method.integrator": "velocity-verlet", "method.dt": dt})
    position, _ = reference.simulate(scene, round(1.5 / dt), integrator=reference.EXPLICIT_DAMPING_VERLET)
    printed = EXPLICIT_DAMPER[scene_name][dt]
    assert rms(position, converged_scenes[scene_name][0]) == pytest.approx(printed, rel=0.02)
