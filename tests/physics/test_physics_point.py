"""One mass: free fall in closed form (docs/method/cases.md A2), and the oscillator on one spring (A3)."""

from math import acos, exp, sqrt

import numpy as np
import pytest

from softlab.model.core.integrators import INTEGRATORS, amplification_matrix
from softlab.model.scene.scene import Scene

NAMES = ["lab", "semi-implicit-euler", "velocity-verlet", "rk4"]
TOLERANCE = {"float64": 1e-11, "float32": 2e-5}  # relative: 100 steps, each rounding y and v by eps / 2, several times


def falling(name: str, coefficient: float, dt: float = 0.01) -> Scene:
    """A sheet at rest length falls like a point: its springs stay slack. 0.01 kg, g = 9.81."""
    return Scene(
        {
            "grid": {"rows": 1, "columns": 2},
            "springs": {},
            "gravity": {},
            "damping": {"coefficient": coefficient},
            "method": {"integrator": name, "dt": dt},
        }
    )


def closed_form(name: str, h: float, n: int, gamma: float, g: float = -9.81) -> tuple[float, float]:
    """(y, v) after n steps from rest at 0, from the recurrence of each step.

    One-force steps: v_n = (g / gamma)(1 - (1 - s h gamma)^n), y_n = h sum v_k (s = 1/2 for lab, 1 for semi). Verlet and
    RK4: v' = a v + b, y' = y + c v + d with a, b, c, d from one step on (y, v, 1).
    """
    if name in ("lab", "semi-implicit-euler"):
        s = 0.5 if name == "lab" else 1.0
        if gamma == 0:
            return s * g * h * h * n * (n + 1) / 2, s * g * h * n
        v = [(g / gamma) * (1 - (1 - s * h * gamma) ** k) for k in range(n + 1)]
        return h * sum(v), v[-1]
    z = h * gamma
    if name == "velocity-verlet":
        a, b = (1 - z / 2) / (1 + z / 2), h * g / (1 + z / 2)
        c, d = h * (1 - z / 2), h * h * g / 2
    else:  # the Taylor series of the exact solution to order 4
        phi1 = 1 - z / 2 + z**2 / 6 - z**3 / 24  # of (1 - exp(-z)) / z
        phi2 = 1 / 2 - z / 6 + z**2 / 24  # of (exp(-z) - 1 + z) / z^2
        a, b, c, d = 1 - z * phi1, h * g * phi1, h * phi1, h * h * g * phi2
    y = v = 0.0
    for _ in range(n):
        y, v = y + c * v + d, a * v + b
    return y, v


@pytest.mark.parametrize("coefficient", [0.0, 0.03])
@pytest.mark.parametrize("name", NAMES)
def test_free_fall(run, name, coefficient, precision, kernel):
    """100 steps of 0.01 s against the step's own closed form; the spring between the two masses never acts."""
    if precision == "float32" and name in ("semi-implicit-euler", "rk4") and kernel == "fused":
        pytest.skip("one precision is enough for these: every fused variant costs seconds to compile")
    state = run(falling(name, coefficient), 100, kernel=kernel, precision=precision, live=("damping", "gravity"))
    y, v = closed_form(name, 0.01, 100, coefficient / 0.01)
    assert state.position[:, 1] == pytest.approx(y, rel=TOLERANCE[precision])
    assert state.velocity[:, 1] == pytest.approx(v, rel=TOLERANCE[precision])
    assert np.array_equal(state.position[:, 0], [0, 1])


@pytest.mark.parametrize(
    ("name", "coefficient", "y", "v"),
    [
        ("lab", 0, -2.477025, -4.905),
        ("lab", 0.03, -1.596413513451, -2.548608862765),
        ("semi-implicit-euler", 0, -4.95405, -9.81),
        ("semi-implicit-euler", 0.03, -2.262977266630, -3.114503299084),
        ("velocity-verlet", 0, -4.905, -9.81),
        ("rk4", 0, -4.905, -9.81),
        ("rk4", 0.03, -2.234267905648, -3.107196282),
    ],
)
def test_closed_forms_are_the_published_values(name, coefficient, y, v):
    """A2's table. The exact fall is -4.905, -9.81: the hand-out's step falls half as far (fact 1)."""
    found = closed_form(name, 0.01, 100, coefficient / 0.01)
    assert found == pytest.approx((y, v), rel=1e-9)


def test_damped_verlet_is_second_order_in_free_fall():
    """Implicit damping: against the exact -2.234267904521 the error falls by 4 when h is halved."""
    exact = -9.81 / 3 * (1 - (1 - exp(-3.0)) / 3)
    assert exact == pytest.approx(-2.234267904521, abs=1e-12)
    errors = [closed_form("velocity-verlet", 1 / n, n, 3.0)[0] - exact for n in (100, 200, 400)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.02)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.02)


def oscillator(name: str, dt: float, coefficient: float = 0.0) -> Scene:
    """A mass hanging on one spring without gravity: x'' = -1000 x - gamma x', x its extension along -y."""
    return Scene(
        {
            "grid": {"rows": 2, "columns": 1, "pinned": "top"},
            "springs": {},
            "damping": {"coefficient": coefficient},
            "method": {"integrator": name, "dt": dt},
        }
    )


W = sqrt(1000.0)
LIVE = ("damping", "gravity")  # one compiled variant with and without them; a test in test_cpu_bits.py says it is equal


def extensions(opened, scene, state, steps, kernel="fused") -> np.ndarray:
    """(steps + 1,): the extension -y - 1 after every step."""
    found = np.empty(steps + 1)
    with opened(scene, initial=state, kernel=kernel, live=LIVE) as simulation:
        found[0] = -simulation.read("position")[1, 1] - 1
        for k in range(steps):
            simulation.advance(1)
            found[k + 1] = -simulation.read("position")[1, 1] - 1
    return found


@pytest.mark.parametrize(
    ("name", "printed"),
    [("lab", 22.407529), ("semi-implicit-euler", 31.756043), ("velocity-verlet", 31.756043)],
)
def test_frequency(opened, start_at, name, printed, kernel):
    """The discrete frequency W' at h = 0.01: cos(W' h) = 1 - s h^2 w^2 / 2 (s = 1/2 for lab).

    Every undamped discrete oscillation obeys x_{n+1} + x_{n-1} = 2 cos(W' h) x_n, so a least-squares fit gives W' to
    rounding; zero crossings, interpolated by that sinusoid, give the same to 1e-6 over 300 steps.
    """
    h, steps = 0.01, 300
    scene = oscillator(name, h)
    x = extensions(opened, scene, start_at(scene, [[0, 0], [0, -1.1]]), steps, kernel)
    cosine = ((x[2:] + x[:-2]) @ x[1:-1]) / (2 * x[1:-1] @ x[1:-1])
    frequency = acos(cosine) / h
    half = 0.5 if name == "lab" else 1.0
    assert frequency == pytest.approx(acos(1 - half * (h * W) ** 2 / 2) / h, rel=1e-11)
    assert frequency == pytest.approx(printed, abs=1e-6)
    before = np.flatnonzero(x[:-1] * x[1:] < 0)
    # between two samples of a sin(W' t + p): the zero lies at atan2(x0 sin, x1 - x0 cos) after the first, over W'
    zero = (
        before * h
        + np.arctan2(-x[before] * np.sin(frequency * h), x[before + 1] - x[before] * cosine) % np.pi / frequency
    )
    assert np.pi / np.diff(zero) == pytest.approx(printed, abs=1e-6)


def test_rk4_loses_its_known_share(opened, start_at):
    """|R|^2 = 1 - z^6/72 + z^8/576 a step, z = h w: x^2 + (v/w)^2 shrinks by exactly that (amplitude 0.9999931423)."""
    h, steps = 0.01, 500
    scene = oscillator("rk4", h)
    with opened(scene, initial=start_at(scene, [[0, 0], [0, -1.1]]), live=LIVE) as simulation:
        simulation.advance(steps)
        state = simulation.state()
    z = h * W
    factor = 1 - z**6 / 72 + z**8 / 576
    assert sqrt(factor) == pytest.approx(0.9999931423, abs=1e-10)
    size = (-state.position[1, 1] - 1) ** 2 + (state.velocity[1, 1] / W) ** 2
    assert size == pytest.approx(0.01 * factor**steps, rel=1e-10)


@pytest.mark.parametrize("coefficient", [0.0, 0.03])
@pytest.mark.parametrize("name", NAMES)
def test_oscillator_follows_its_matrix(run, start_at, name, coefficient, kernel):
    """On a line the spring is linear while stretched or shorter: n steps are M^n exactly (M: amplification_matrix)."""
    scene = oscillator(name, 0.01, coefficient)
    state = run(scene, 100, kernel=kernel, initial=start_at(scene, [[0, 0], [0, -1.1]]), live=LIVE)
    x, v = np.linalg.matrix_power(amplification_matrix(name, 0.01, W, coefficient / 0.01), 100) @ [0.1, 0]
    assert -state.position[1, 1] - 1 == pytest.approx(x, abs=1e-12)
    assert -state.velocity[1, 1] == pytest.approx(v, abs=1e-12 / 0.01)  # lab divides a position's rounding by dt


@pytest.mark.parametrize(
    ("coefficient", "values"),
    [(0.0, {1.0: 0.0978682697}), (0.03, {0.5: -0.0472554316, 1.0: 0.0221671902, 2.0: 0.00476892313})],
)
def test_oscillator_reaches_the_exact_motion(run, start_at, coefficient, values):
    """RK4 at h = 1e-3 against x'' = -w^2 x - gamma x': phase error t w z^4/120 = 3e-7 rad at 1 s, times 0.1 m."""
    scene = oscillator("rk4", 1e-3, coefficient)
    for time, value in values.items():
        state = run(scene, round(time * 1000), initial=start_at(scene, [[0, 0], [0, -1.1]]), live=LIVE)
        assert -state.position[1, 1] - 1 == pytest.approx(value, abs=1e-7)


def test_hand_out_step_converges_to_half_the_acceleration(run, start_at):
    """Fact 1: lab's damped oscillation tends to 0.00993147247, -0.0448131037, 0.0173548148 at 0.5, 1, 2 s, at order 1
    (h = 1e-4: |error| about h w^2 t/8 of 0.1 m = 5e-4), and not to Newton's -0.0472554316, ..."""
    scene = oscillator("lab", 1e-4, 0.03)
    for time, half, newton in (
        (0.5, 0.00993147247, -0.0472554316),
        (1.0, -0.0448131037, 0.0221671902),
        (2.0, 0.0173548148, 0.00476892313),
    ):
        state = run(scene, round(time * 10_000), initial=start_at(scene, [[0, 0], [0, -1.1]]), live=LIVE)
        x = -state.position[1, 1] - 1
        assert x == pytest.approx(half, abs=5e-4)
        assert abs(x - newton) > 0.01
    assert INTEGRATORS["lab"].order == 0
