"""The equations of an implicit step: Newton's method on them, Baraff and Witkin's linearised step, XPBD's fixed point."""

from __future__ import annotations

from typing import Any

import numpy as np
from cloth_solve import cloth
from test_implicit import STIFF, method, stepped

from softlab.bench.reference import implicit, mass_spring, xpbd
from softlab.model.core.build import build
from softlab.model.scene.scene import Scene


def taut() -> tuple[Scene, np.ndarray, np.ndarray]:
    """A sheet held at its edges, stretched to 1.3 of its rest lengths and rippled: no spring is or will be pressed."""
    scene = cloth(7, 5, **(STIFF | {"sheet": {"pinned": "edges", "spacing": 0.1, "mass": 0.01}}), **method(0.01))
    i, j = np.mgrid[:7, :5]
    position = 1.3 * build(scene).position
    ripple = 0.01 * np.stack([np.sin(2.0 * i + j), np.cos(i - 2.0 * j), np.sin(i * j)], axis=-1)
    ripple[[0, -1]] = ripple[:, [0, -1]] = 0
    return scene, position + ripple.reshape(-1, 3), np.zeros((35, 3))


def test_newton_converges_quadratically_where_no_spring_is_pressed() -> None:
    """Then nothing is clamped and the matrix is the whole derivative: |r'| = C |r|^2. From residuals that shrink 600-fold to
    ones that shrink 90 000-fold C stays what it is, within a factor of ten (at a linear rate it would grow 600-fold). The
    kernel, which solves each matrix to a part of the reduction before (Eisenstat and Walker), needs a few matrices more."""
    scene, position, velocity = taut()
    sheet = position.reshape(7, 5, 3)
    gravity = np.broadcast_to([0.0, -9.81, 0.0], sheet.shape)
    found = implicit.solve(scene, sheet, np.zeros_like(sheet), gravity, False, 0.01)
    _, large, small, least = found.residuals[:4]
    assert large / small > 500 and small / least > 5e4
    assert least / small**2 < 10 * small / large**2
    _, done = stepped(scene, 1, (position, velocity))
    assert 3 <= done[1] <= 6 and done[3] == 0


def test_the_linearised_step_is_the_first_newton_iterate() -> None:
    """To its 1e-6 of the first residual; and Newton's method does not stop there."""
    scene, position, velocity = taut()
    once = scene.replace({"method.integrator": "implicit-euler-linear"})
    sheet = position.reshape(7, 5, 3)
    gravity = np.broadcast_to([0.0, -9.81, 0.0], sheet.shape)
    found = implicit.solve(scene, sheet, np.zeros_like(sheet), gravity, False, 0.01)
    state, done = stepped(once, 1, (position, velocity))
    assert done[1] == 1
    assert np.linalg.norm(state.velocity - found.first.reshape(-1, 3)) < 1e-6 * found.residuals[0]
    assert np.linalg.norm(state.velocity - found.velocity.reshape(-1, 3)) > 1e-5 * found.residuals[0]
    newton, _ = stepped(scene, 1, (position, velocity))
    assert np.linalg.norm(newton.velocity - found.velocity.reshape(-1, 3)) < 1e-8 * found.residuals[0]


def test_it_is_baraff_and_witkins_step() -> None:
    """(1 - dt df/dv - dt^2 df/dx) dv = dt (f + dt df/dx v), their eq. 6, with the derivatives by central differences."""
    scene, position, _ = taut()
    dampers = {f"{kind}.damping": 0.05 for kind in ("structural", "shear", "bending")}
    scene = scene.replace(dampers | {"damping.coefficient": 0.02, "method.integrator": "implicit-euler-linear"})
    free = np.flatnonzero(build(scene).inverse_mass > 0)
    velocity = np.zeros((35, 3))
    velocity[free] = np.sin(np.arange(3.0 * len(free))).reshape(-1, 3)
    h, mass, shape = 0.01, 0.01, (7, 5, 3)

    def f(p: np.ndarray, v: np.ndarray) -> np.ndarray:
        force = mass_spring.cloth.forces(scene, p.reshape(shape), v.reshape(shape), 0.0, 0).reshape(-1, 3)
        return ((force - 0.02 * v) / mass)[free].ravel()

    def derivative(which: int) -> np.ndarray:
        columns = []
        for k in range(3 * len(free)):
            ends = []
            for sign in (1, -1):
                state = [position.copy(), np.zeros((35, 3)) if which == 0 else velocity.copy()]
                state[which][free[k // 3], k % 3] += sign * 1e-6
                ends.append(f(*state))
            columns.append((ends[0] - ends[1]) / 2e-6)
        return np.stack(columns, axis=1)

    by_position, by_velocity = derivative(0), derivative(1)
    v = velocity[free].ravel()
    rhs = h * (f(position, velocity) + h * by_position @ v)
    change = np.linalg.solve(np.eye(len(v)) - h * by_velocity - h * h * by_position, rhs)
    state, _ = stepped(scene, 1, (position, velocity))
    assert np.linalg.norm(state.velocity[free].ravel() - (v + change)) < 3e-6 * np.linalg.norm(v + rhs)


def test_converged_xpbd_is_implicit_euler_but_for_the_turning() -> None:
    """A chain of 11 masses for 18 frames: hanging, to rounding; let go from the horizontal XPBD, which drops how springs
    turn within a step, is off by 1e-4 m, and at a quarter of the step by a sixteenth of that or less."""
    sheet = {"pinned": [[0, 0]], "spacing": 1.0, "mass": 0.01}
    parts: dict[str, Any] = {"structural": {"stiffness": 10.0}, "gravity": {}, "sheet": sheet}
    for rows, columns, bounds in ((11, 1, (1e-12, 1e-12)), (1, 11, (1.2e-4, 1.2e-4 / 16))):
        for substeps, bound in zip((1, 4), bounds, strict=True):
            dt = 1 / 60 / substeps
            expected, _ = implicit.simulate(cloth(rows, columns, **parts, **method(dt)), 18 * substeps)
            scene = cloth(rows, columns, **parts, method={"solver": "xpbd", "dt": dt})
            found, _ = xpbd.simulate(scene, 18 * substeps, iterations=100)
            assert np.abs(found - expected).max() < bound
