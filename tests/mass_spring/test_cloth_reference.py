"""The cloth against closed forms: by its NumPy reference first, which judges the backends, then by these themselves."""

from __future__ import annotations

from math import cos, exp, pi, sin, sqrt

import numpy as np
import pytest
from cloth_solve import accelerations, cloth, each_solver, solve

from softlab.bench.reference import cloth as reference_cloth
from softlab.bench.reference import mass_spring as reference
from softlab.model.core.build import build
from softlab.model.core.energy import energies
from softlab.model.scene.scene import load_scene

ALL_SPRINGS = {
    "structural": {"stiffness": 100.0, "damping": 0.05},
    "shear": {"stiffness": 60.0, "damping": 0.02},
    "bending": {"stiffness": 10.0, "damping": 0.01},
}
EPSILON = np.finfo(np.float64).eps


def moving(rows: int, columns: int, **parts):
    """A free cloth far from rest: every mass displaced by up to half a spacing and flying at up to 1 m/s."""
    scene = cloth(rows, columns, **parts)
    random = np.random.default_rng(7)
    position = reference.start(scene)[0] + 0.06 * random.uniform(-1, 1, (rows * columns, 3))
    return scene, position, random.uniform(-1, 1, (rows * columns, 3))


@pytest.mark.parametrize("name", ["cloth-hanging", "cloth-wind", "cloth-sphere"])
def test_starts_where_the_backends_do(name):
    """The same masses as model/core/build.py, written twice: within two roundings of a coordinate of 3 m."""
    scene = load_scene(name).replace({"perturbation.amplitude": 0.01})
    position, velocity = reference.start(scene)
    assert np.abs(position - build(scene).position).max() <= 4 * EPSILON
    assert np.array_equal(velocity, build(scene).velocity)
    assert np.array_equal(reference.pinned_mask(scene).ravel(), build(scene).inverse_mass == 0)


def test_forces_are_minus_the_energys_gradient():
    """F = -dE/dp by central differences of model/core/energy.py: truncation h^2 E''' / 6 < 1e-10 * k / L0, rounding E eps /
    h."""
    parts = {kind: {"stiffness": part["stiffness"]} for kind, part in ALL_SPRINGS.items()}
    scene, position, velocity = moving(4, 5, gravity={}, **parts)
    force = reference_cloth.forces(scene, position.reshape(4, 5, 3), velocity.reshape(4, 5, 3), 0.0, 0).reshape(-1, 3)
    h = 1e-5
    for particle in range(20):
        for axis in range(3):
            ends = []
            for sign in (1, -1):
                moved = position.copy()
                moved[particle, axis] += sign * h
                ends.append(energies(scene, moved, velocity)["potential"])
            assert force[particle, axis] == pytest.approx(-(ends[0] - ends[1]) / (2 * h), abs=1e-6)


@each_solver
@pytest.mark.parametrize("integrator", ["velocity-verlet", "semi-implicit-euler"])
def test_springs_and_their_dampers_keep_both_momenta(solver, integrator):
    """A8: inner forces are equal, opposite and central, and both integrators kick and drift along them, so that momentum
    and angular momentum change by rounding alone: 1e-13 of the sum of all masses' own."""
    scene, position, velocity = moving(6, 7, **ALL_SPRINGS, method={"integrator": integrator, "dt": 1e-3})
    later, speed = solve(solver, scene, 300, position, velocity)
    assert np.abs(speed - velocity).max() > 0.1  # something happened
    assert np.abs((speed - velocity).sum(axis=0)).max() < 1e-13 * np.abs(velocity).sum()
    spin, before = np.cross(later, speed), np.cross(position, velocity)
    assert np.abs((spin - before).sum(axis=0)).max() < 1e-13 * np.abs(before).sum()


@each_solver
def test_hanging_column(solver):
    """A4: link i carries the weights below it, y_i = -sum (L0 + (n - j + 1) m g / k).

    Damped at twice its slowest frequency w = 2 sqrt(k/m) sin(pi / (4n + 2)) it is at rest, to e^-30, after 30 / w.
    """
    n, k, m = 5, 100.0, 0.01
    slowest = 2 * sqrt(k / m) * sin(pi / (4 * n + 2))
    scene = cloth(
        n + 1, 1, sheet={"pinned": "top", "mass": m}, structural={"stiffness": k}, gravity={},
        damping={"coefficient": 2 * slowest * m}, method={"integrator": "velocity-verlet", "dt": 0.002},
    )  # fmt: skip
    position, velocity = solve(solver, scene, round(40 / slowest / 0.002))
    links = 0.125 + (n - np.arange(n)) * m * 9.81 / k
    assert position[:, 1] == pytest.approx(np.append(0, -np.cumsum(links)), abs=1e-12)
    assert np.abs(velocity).max() < 1e-10 and not position[:, [0, 2]].any()


@each_solver
@pytest.mark.parametrize(("kind", "ends"), [("structural", (0, 1)), ("shear", (0, 3)), ("bending", (0, 2))])
def test_one_damped_spring(solver, kind, ends):
    """Two masses m swing along their spring like one of m/2: u'' = -(2k/m) u - (2c/m) u', whatever way it points.

    Against its closed form at 0.25 s; RK4's error is (w h)^5 / 120 a step: 500 steps of w h = 0.09 make 2e-8 of u.
    """
    rows, columns = {"structural": (1, 2), "shear": (2, 2), "bending": (1, 3)}[kind]
    k, c, m, u = 100.0, 0.05, 0.1, 0.01
    scene = cloth(
        rows, columns, sheet={"mass": m}, **{kind: {"stiffness": k, "damping": c}},
        method={"integrator": "rk4", "dt": 0.0005},
    )  # fmt: skip
    position = reference.start(scene)[0]
    first, second = ends
    way = position[second] - position[first]
    length, way = np.linalg.norm(way), way / np.linalg.norm(way)
    position[first] -= u / 2 * way
    position[second] += u / 2 * way
    position = position @ np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    g, t = c / m, 0.25
    w = sqrt(2 * k / m - g * g)
    expected = u * exp(-g * t) * (cos(w * t) + g / w * sin(w * t))
    later, _ = solve(solver, scene, 500, position)
    assert np.linalg.norm(later[second] - later[first]) - length == pytest.approx(expected, abs=1e-7 * u)


@each_solver
@pytest.mark.parametrize("degrees", [0, 10, 45, 80, 90])
def test_wind_on_a_plate(solver, degrees):
    """Density/2 |u|^2 A times drag sin a along the air and lift sin a cos a across it, for a plate at angle a.

    The plate rises down the wind, so that the lift presses it down. To rounding: 1e-12 of the plate's whole drag.
    """
    angle, speed, area = np.radians(degrees), 7.0, (3 * 0.125) * (2 * 0.125)
    wind = {"velocity": (speed, 0.0, 0.0), "density": 1.2, "drag": 1.1, "lift": 0.6}
    scene = cloth(3, 4, sheet={"placement": "flat"}, wind=wind)
    across, _, along = reference.start(scene)[0].T
    position = np.stack([across * np.cos(angle), across * np.sin(angle), along], axis=1)
    force = scene.grid.mass * accelerations(solver, scene, position).sum(axis=0)
    pressure = 1.2 / 2 * speed**2 * area
    drag, lift = 1.1 * np.sin(angle), 0.6 * np.sin(angle) * np.cos(angle)
    assert force == pytest.approx([pressure * drag, -pressure * lift, 0], abs=1e-12 * pressure)


@each_solver
def test_wind_that_blows_as_fast_as_the_cloth_flies_does_nothing(solver):
    scene, position, _ = moving(4, 5, wind={"velocity": (1.0, -2.0, 0.5)})
    assert not accelerations(solver, scene, position, np.tile([1.0, -2.0, 0.5], (20, 1))).any()
    still = scene.replace({"wind.velocity": (0.0, 0.0, 0.0)})
    assert not accelerations(solver, still, position).any()


@each_solver
def test_terminal_velocity_of_a_flat_sheet(solver):
    """It falls at constant momentum where density/2 drag A v^2 = M g; faster it is braked, slower it gains speed."""
    scene = cloth(4, 4, sheet={"placement": "flat"}, gravity={}, wind={"velocity": (0.0, 0.0, 0.0), "lift": 0.0})
    weight, area = 16 * scene.grid.mass * 9.81, (3 * 0.125) ** 2
    terminal = sqrt(weight / (1.2 / 2 * area))
    pulls = [
        scene.grid.mass * accelerations(solver, scene, velocity=np.tile([0, -share * terminal, 0], (16, 1))).sum(axis=0)
        for share in (1.0, 2.0, 0.5)
    ]
    assert pulls[0] == pytest.approx(np.zeros(3), abs=1e-11 * weight)  # velocities of 14 m/s lose digits to dt
    assert [pull[1] / weight for pull in pulls[1:]] == pytest.approx([3.0, -0.75], abs=1e-11)


@each_solver
def test_gusts(solver):
    """At the start of an interval the air moves at wind (1 + gust r) with the interval's own random number r, the first
    word of the external force's generator; halfway to the next at the mean of both."""
    from softlab.bench.reference.philox import random_directions

    wind = {"velocity": (0.0, 3.0, 0.0), "gust": 0.5, "gust_time": 2.0**-4, "seed": 5, "lift": 0.0}
    scene = cloth(3, 3, sheet={"placement": "flat", "mass": 1e9}, wind=wind)
    scene = scene.replace({"method.integrator": "semi-implicit-euler", "method.dt": 2.0**-10})
    numbers = [random_directions(5, interval, 1)[0, 0] for interval in range(3)]
    expected = [numbers[0], (numbers[0] + numbers[1]) / 2, numbers[1]]
    speeds = [solve(solver, scene, steps)[1][:, 1].sum() for steps in (0, 1, 32, 33, 64, 65)]
    for place, number in enumerate(expected):  # steps 0, 32 and 64 begin at these times
        force = 1e9 * (speeds[2 * place + 1] - speeds[2 * place]) * 2.0**10
        air = 3.0 * (1 + 0.5 * number)
        assert force == pytest.approx(1.2 / 2 * 0.0625 * air * abs(air), rel=1e-6)


@each_solver
def test_random_force_takes_three_words_a_mass(solver):
    from softlab.bench.reference.philox import random_directions

    scene = cloth(3, 4, external={"magnitude": 0.02, "seed": 11})
    expected = 0.02 / scene.grid.mass * random_directions(11, 0, 12, axes=3)
    assert accelerations(solver, scene) == pytest.approx(expected, abs=1e-12)
