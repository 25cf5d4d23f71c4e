"""The NumPy reference of XPBD on sheets: momenta, orderings, the motion of the springs that it stands for."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from test_xpbd_reference import G

from softlab.bench.reference import mass_spring, xpbd
from softlab.model.scene.scene import Scene, load_scene

CLOTH = {
    "cloth": {"rows": 6, "columns": 5, "spacing": 0.1, "mass": 0.01, "pinned": []},
    "structural": {"stiffness": 100.0, "damping": 0.02},
    "shear": {"stiffness": 60.0, "damping": 0.01},
    "bending": {"stiffness": 10.0},
    "perturbation": {"amplitude": 0.02},
    "method": {"dt": 0.004},
}


def loose(seed: int = 1) -> tuple[Scene, np.ndarray, np.ndarray]:
    """A free cloth without gravity, its start, and velocities that sum to 0."""
    scene = Scene(CLOTH)
    position, _ = mass_spring.start(scene)
    velocity = np.random.default_rng(seed).normal(size=position.shape)
    return scene, position, velocity - velocity.mean(axis=0)


def test_each_iteration_keeps_angular_momentum():
    """Along d, opposite and equal: sum of m p x (change of p) is 0 where nothing else moves meanwhile (Jacobi)."""
    scene, position, velocity = loose()
    constraints, h = xpbd.of_scene(scene), 0.004
    w = np.full(len(position), 100.0)
    p = position + h * velocity
    new, _ = xpbd.iterate(constraints, p, np.zeros(len(constraints.first)), position, w, h, "jacobi")
    assert np.abs(new - p).max() > 1e-3
    assert np.abs(np.cross(p, new - p).sum(axis=0)).max() < 1e-15


def test_multipliers_live_through_the_iterations():
    """|C + a~ lambda| at least halves with every iteration and stays at rounding (lengths of 0.1 m: 1e-17) from the
    twentieth on; with the multipliers forgotten in between it stalls."""
    scene, position, velocity = loose()
    constraints, h = replace(xpbd.of_scene(scene), damping=np.zeros(127)), 0.004
    w = np.full(len(position), 100.0)
    found = []
    for n in range(1, 51):
        state = xpbd.substep(constraints, position, velocity, 0.0, w, h, n)
        found.append(xpbd.residuals(constraints, state, position, w, h)[0])
    assert all(b < a / 2 for a, b in pairwise(found) if a > 1e-14)
    assert max(found[20:]) < 1e-16
    p, none = state.predicted, np.zeros(127)
    for _ in range(50):
        p, last = xpbd.iterate(constraints, p, none, position, w, h, "gauss-seidel")
    forgot = xpbd.residuals(constraints, replace(state, iterated=p, multipliers=last), position, w, h)[0]
    assert forgot > 1e-2 * found[0]


@pytest.mark.parametrize("damped", [False, True])
def test_orderings_agree_when_converged(damped):
    """Not the same point to rounding: each keeps the directions its iterations went through (XPBD 2016, section 4.3).

    A correction, of order h^2, times how far it turned, h^2 again: a tenth of h divides it by 1e4, once small enough.
    """
    scene, position, velocity = loose()
    constraints = xpbd.of_scene(scene)
    constraints = constraints if damped else replace(constraints, damping=np.zeros(127))
    w, apart = np.full(len(position), 100.0), []
    for h in (4e-3, 4e-4):
        ends = []
        for ordering, iterations in (
            ("gauss-seidel", 30),
            ("ascending", 30),
            ("jacobi", 500),
            ("weighted-jacobi", 500),
        ):
            state = xpbd.substep(constraints, position, velocity, 0.0, w, h, iterations, ordering)
            assert xpbd.residuals(constraints, state, position, w, h)[0] < 1e-15
            ends.append(state.position)
        apart.append(max(np.abs(ends[0] - other).max() for other in ends[1:]))
    assert apart[0] < 1e-3
    assert apart[1] < apart[0] / 1000


def test_first_order_with_dampers_along_the_springs():
    """To the motion of bench.reference.cloth, dampers and wind in: halving h halves the error (to 10 %: next order)."""
    scene = Scene(
        CLOTH
        | {
            "cloth": CLOTH["cloth"] | {"pinned": "top-corners"},
            "damping": {"coefficient": 0.005},
            "gravity": {"acceleration": G},
            "wind": {"velocity": [1.0, 0.0, 3.0], "gust": 0.0},
        }
    )
    truth, _ = mass_spring.simulate(scene.replace({"method.dt": 0.0005}), 200, integrator="rk4")
    errors = []
    for substeps in (16, 32, 64):
        p, _ = xpbd.simulate(scene, 25, substeps=substeps, iterations=2)
        errors.append(np.abs(p - truth).max())
    assert errors[0] / errors[1] == pytest.approx(2, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize(
    ("ordering", "reached"), [("gauss-seidel", 1.0), ("weighted-jacobi", 1.0), ("jacobi", 1 - (11 / 12) ** 2)]
)
def test_stiffness_of_two_iterations_in_the_limit_of_short_substeps(ordering, reached):
    """Where a~ is far above the inverse masses no constraint feels another, and the first iteration has the answer.

    Jacobi divided by the valence V does not let it: n iterations give 1 - (1 - 1/V)^n of the force, at any h. In the
    middle of a cloth V = 12: two iterations make springs of a sixth of their stiffness, and substeps do not repair it.
    """
    ways = {way: xpbd.Direction(0.1 * float(np.hypot(*way)), 0.01) for way in xpbd.COLOURS}
    constraints = xpbd.sheet(9, 9, ways)
    p = 1.01 * np.stack(np.meshgrid(np.arange(9), np.arange(9)), axis=-1).reshape(-1, 2) * 0.1
    state = xpbd.substep(constraints, p, np.zeros_like(p), 0.0, np.full(81, 100.0), 1e-7, 2, ordering)
    middle = (constraints.first == 40) | (constraints.second == 40)
    force = -state.multipliers[middle] / 1e-14
    np.testing.assert_allclose(force, reached * 0.01 * constraints.rest_length[middle] / 0.01, rtol=1e-6)


GUSTS = CLOTH | {
    "cloth": CLOTH["cloth"] | {"pinned": "top"},
    "gravity": {"acceleration": G},
    "wind": {"velocity": [1.0, 0.0, 3.0], "gust": 0.5, "gust_time": 0.03},
    "sphere": {"center": [0.2, -0.2, -0.2], "radius": 0.15, "thickness": 0.01, "velocity": [0.0, 0.0, 2.0]},
}


@pytest.mark.parametrize("scene", [load_scene("lab-hammock"), Scene(GUSTS)], ids=["grid", "cloth"])
def test_substeps_are_short_steps(scene):
    """4 substeps of a step of 0.02 s are 4 steps of 0.005 s, bit for bit, with gusts and a ball that moves."""
    one = xpbd.simulate(scene.replace({"method.dt": 0.02}), 5, substeps=4, iterations=2)
    four = xpbd.simulate(scene.replace({"method.dt": 0.005}), 20, iterations=2)
    np.testing.assert_array_equal(one, four)
