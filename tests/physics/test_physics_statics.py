"""At rest: hanging chain, hanging grid, two-corner equilibrium (docs/method/cases.md A4)."""

from math import sqrt

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.scene.scene import Scene

LIVE = ("damping", "gravity")
SLOWEST = 2 * sqrt(1000) * np.sin(np.pi / 42)  # 1/s, of the ten-link chain: settling takes 1 / (gamma / 2) = 0.67 s


def hanging(rows: int, columns: int, pinned: str, name: str = "velocity-verlet", dt: float = 0.02) -> Scene:
    return Scene(
        {
            "grid": {"rows": rows, "columns": columns, "pinned": pinned},
            "springs": {},
            "gravity": {},
            "damping": {},
            "method": {"integrator": name, "dt": dt},
        }
    )


def chain_depths(links: int) -> np.ndarray:
    """y_i = -sum_{j <= i} (L0 + (n - j + 1) m g / k): every link carries the weight below it."""
    j = np.arange(1, links + 1)
    return -np.cumsum(1.0 + (links - j + 1) * 0.00981)


def stall(name: str, precision: str, dt: float, size: float) -> float:
    """Where rounding stops the approach to rest: the displacement (times 4, for sums of such stops) whose pull
    a = w^2 x no longer moves a coordinate of magnitude `size`, ulp u: lab stops when dt^2 a / 2 < u / 2; the steps that
    store the velocity when dt v < u / 2 with v = a / gamma, the velocity that the damper allows."""
    ulp = float(np.spacing(np.float32(size) if precision == "float32" else np.float64(size)))
    acceleration = ulp / dt**2 if name == "lab" else 3.0 * ulp / (2 * dt)
    return 4 * (acceleration / SLOWEST**2 + ulp)


@pytest.mark.parametrize("name", ["lab", "semi-implicit-euler", "velocity-verlet", "rk4"])
def test_hanging_chain(run, name, precision):
    """Ten links: the slowest mode (4.73 1/s, damping 3 1/s) decays as exp(-1.5 t) (lab: -0.75 t): 1e-8 needs 12 s.

    float64 to 1e-8. float32 to where rounding stops it (`stall`): 2e-6 m; for lab 1.7e-4 m, which subtracts positions.
    """
    if precision == "float32" and name in ("semi-implicit-euler", "rk4"):
        pytest.skip("compiled for lab and velocity-verlet only")
    dt, time = 0.02, 28.0 if name == "lab" else 14.0
    state = run(hanging(11, 1, "top", name, dt), round(time / dt), precision=precision, live=LIVE)
    expected = np.concatenate([[0], chain_depths(10)])
    assert expected[-1] == pytest.approx(-10.53955)
    tolerance = max(1e-8, stall(name, precision, dt, 10.5))
    assert state.position[:, 1] == pytest.approx(expected, abs=tolerance)
    assert np.all(state.position[:, 0] == 0)


def test_anchor_force(run):
    """The top spring carries all ten masses: 10 m g = 0.981 N."""
    state = run(hanging(11, 1, "top"), 700, live=LIVE)
    assert 10.0 * (np.hypot(*(state.position[1] - state.position[0])) - 1.0) == pytest.approx(0.981, abs=1e-7)


@pytest.mark.parametrize("name", ["lab", "velocity-verlet"])
def test_hanging_grid(run, name):
    """10 x 10, top row fixed: columns hang as nine-link chains, x unchanged, no residual force."""
    scene = hanging(10, 10, "top", name)
    state = run(scene, 1400 if name == "lab" else 700, live=LIVE)
    expected = np.concatenate([[0], chain_depths(9)])
    assert expected[-1] == pytest.approx(-9.44145)
    grid = state.position.reshape(10, 10, 2)
    assert np.abs(grid[..., 1] - expected[:, None]).max() < 1e-8
    assert np.abs(grid[..., 0] - np.arange(10)).max() < 1e-12
    assert largest_residual(scene, state.position) < 1e-8 * 40  # error times the largest eigenvalue 4 k


def largest_residual(scene: Scene, position: np.ndarray) -> float:
    """The largest net force [N] on a free mass."""
    grid = scene.grid
    force = reference.spring_forces(scene, position.reshape(grid.rows, grid.columns, 2))
    force[..., 1] -= grid.mass * scene.gravity.acceleration
    return float(np.abs(force[~reference.pinned_mask(scene)]).max())


@pytest.mark.parametrize("name", ["semi-implicit-euler", "velocity-verlet"])
def test_two_corner_equilibrium(run, name):
    """10 x 10 on its two top corners, from the drawn grid: the published equilibrium to 1e-8 at 50 s.

    Its softest mode has Hessian 0.01376 N/m, w^2 = 1.376 1/s^2, overdamped: rate 1.5 - sqrt(1.5^2 - 1.376) = 0.565 1/s,
    so metres decay to 1e-11 within 45 s. The start is symmetric, but this equilibrium is positive definite.
    """
    scene = hanging(10, 10, "top-corners", name)
    state = run(scene, 2500, live=LIVE)
    grid = state.position.reshape(10, 10, 2)
    assert grid[9, 0] == pytest.approx((1.083774562154, -9.533558777033), abs=1e-8)
    assert grid[0, 4] == pytest.approx((3.921318596204, -2.733120766706), abs=1e-8)
    assert grid[9, 4, 1] == pytest.approx(-12.0851008037, abs=1e-8)
    from softlab.model.core.energy import energies

    found = energies(scene, state.position, state.velocity)
    assert found["potential"] == pytest.approx(-57.28101438151, abs=1e-9)
    assert largest_residual(scene, state.position) < 1e-9
