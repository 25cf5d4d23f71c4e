"""Large displacements of finite elements, solved to the end by Newton's method: statics, and steps of implicit Euler.

The exact answers on the same mesh (bench/reference/finite_elements.py tells meshes and materials). A step of implicit Euler
is what position-based solvers, vertex block descent and Newton's method in the backends all tend to with more iterations: it
minimises (S. Martin et al., "Example-Based Elastic Materials", ACM TOG 2011, eq. 3)

    sum of m |x - (x_0 + h v_0 + h^2 (g + f/m))|^2 / (2 h^2)  +  energy(x)  +  (x - x_0)' tau K_0 (x - x_0) / (2 h),

the last for damping in proportion to stiffness, a force -tau K_0 v with the stiffness K_0 of the step's start, less its
tetrahedra's negative eigenvalues: a small vibration of angular frequency w is damped at the ratio tau w / 2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from bench.reference.finite_elements import Body, Values, free_coordinates, lumped_mass

ENOUGH = 1e-10  # of the load
MOST = 300  # Newton steps
DOWNHILL = 1e-4  # of the descent that a straight line promises (Armijo)


def _step(matrix: sparse.csc_matrix, force: np.ndarray) -> np.ndarray | None:
    """The Newton step, None where the matrix is singular or the step does not go downhill."""
    try:
        step = splu(matrix).solve(force)
    except RuntimeError:  # exactly singular
        return None
    return step if np.isfinite(step).all() and step @ force > 0 else None


def minimise(
    energy: Callable[[np.ndarray], float],
    force: Callable[[np.ndarray], np.ndarray],
    stiffness: Callable[[np.ndarray, bool], sparse.csc_matrix],
    start: np.ndarray,
    fixed: np.ndarray,
    enough: float,
) -> np.ndarray:
    """(n, 3): where the free coordinates' force [N] is at most `enough` in Euclidean norm, from `start` (n, 3) downhill.

    `stiffness(x, positive)`: (3 n, 3 n), projected only where the exact one leads uphill. RuntimeError where it fails.
    """
    free = free_coordinates(fixed)
    x = np.array(start, dtype=np.float64)
    here, pull = energy(x), force(x).ravel()[free]
    for _ in range(MOST):
        if np.linalg.norm(pull) <= enough:
            return x
        step = _step(stiffness(x, False)[free][:, free].tocsc(), pull)
        if step is None:
            step = _step(stiffness(x, True)[free][:, free].tocsc(), pull)
        if step is None:
            raise RuntimeError("Newton's method: the projected stiffness is singular: is the body held?")
        promised, share = float(step @ pull), 1.0
        while True:
            trial = x.copy()
            trial.reshape(-1)[free] += share * step
            there, left = energy(trial), force(trial).ravel()[free]
            if there <= here - DOWNHILL * share * promised:
                break
            # near the end a descent is less than the energy's rounding: then forces tell
            small = share * np.abs(step).max() <= 1e-6 * np.ptp(x)
            if small and np.linalg.norm(left) < 0.5 * np.linalg.norm(pull):
                break
            share /= 2
            if share < 1e-12:
                raise RuntimeError(f"Newton's method: no way down, {np.linalg.norm(pull):.2e} N left of {enough:.2e} N")
        x, here, pull = trial, there, left
    raise RuntimeError(f"Newton's method: {np.linalg.norm(pull):.2e} N left of {enough:.2e} N after {MOST} steps")


def rounding(body: Body) -> float:
    """[N]: the norm of nodal forces that float64 makes of positions' last digits; no solver gets below it."""
    extent = float(np.abs(body.rest).max())
    stiff = np.linalg.norm(body.stiffness().diagonal())
    return float(np.finfo(np.float64).eps * extent * stiff)


def nonlinear_static(
    position: np.ndarray,
    tetrahedra: np.ndarray,
    young: Values,
    poisson: Values,
    fixed: np.ndarray,
    material: str,
    force: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    density: Values = 0.0,
    load_steps: int = 1,
    start: np.ndarray | None = None,
    enough: float = ENOUGH,
) -> np.ndarray:
    """Positions (n, 3) [m] in equilibrium under `force` (n, 3) [N] and `gravity` [m/s^2] on lumped masses, from `start`
    (rest), where what is `fixed` stays. Forces left: at most `enough` of the load, or what float64 rounds."""
    body = Body.of(position, tetrahedra, material, young, poisson)
    load = np.zeros_like(body.rest) if force is None else np.array(force, dtype=np.float64)
    load = load + lumped_mass(body.rest, body.tetrahedra, density)[:, None] * np.asarray(gravity)
    x = np.array(body.rest if start is None else start, dtype=np.float64)
    free = free_coordinates(fixed)
    size = float(np.linalg.norm(load.ravel()[free])) or float(np.linalg.norm(body.force(x).ravel()[free]))
    floor = rounding(body)
    for number in range(1, load_steps + 1):
        part = load * (number / load_steps)

        def potential(at: np.ndarray, part: np.ndarray = part) -> float:
            return body.energy(at) - float((part * (at - body.rest)).sum())

        def total(at: np.ndarray, part: np.ndarray = part) -> np.ndarray:
            return body.force(at) + part

        near = max((enough if number == load_steps else 1e-3) * size, floor)
        x = minimise(potential, total, body.stiffness, x, fixed, near)
    return x


def implicit_euler(
    body: Body,
    position: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    fixed: np.ndarray,
    h: float,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    force: np.ndarray | None = None,
    damping_time: float = 0.0,
    enough: float = ENOUGH,
) -> tuple[np.ndarray, np.ndarray]:
    """(position [m], velocity [m/s]), (n, 3), after one step `h` [s] of backward Euler, solved to the end: forces left are at
    most `enough` of the inertia's h^2 (or of what float64 rounds). `damping_time`: tau [s] above. What is `fixed` stays."""
    before = np.array(position, dtype=np.float64)
    push = np.zeros_like(before) if force is None else np.asarray(force, dtype=np.float64)
    aim = before + h * velocity + h**2 * (np.asarray(gravity) + push / mass[:, None])
    weight = np.repeat(mass / h**2, 3)
    inertia = sparse.diags(weight).tocsc()
    if damping_time > 0:
        damper = (damping_time / h) * body.stiffness(before, True)
    else:
        damper = sparse.csc_matrix(inertia.shape)

    def energy(x: np.ndarray) -> float:
        away, moved = (x - aim).ravel(), (x - before).ravel()
        return float(weight @ away**2 + moved @ (damper @ moved)) / 2 + body.energy(x)

    def total(x: np.ndarray) -> np.ndarray:
        away, moved = (x - aim).ravel(), (x - before).ravel()
        return body.force(x) - (weight * away + damper @ moved).reshape(-1, 3)

    free = free_coordinates(fixed)
    size = max(np.linalg.norm(total(before).ravel()[free]), np.linalg.norm((weight * (aim - before).ravel())[free]))
    x = minimise(
        energy, total, lambda x, positive: inertia + damper + body.stiffness(x, positive), before, fixed,
        max(enough * float(size), rounding(body)),
    )  # fmt: skip
    return x, (x - before) / h
