"""Large displacements of finite elements, solved to convergence by Newton's method: statics, and implicit Euler.

The results are exact on the same mesh (bench/reference/finite_elements.py has meshes and materials). A step of implicit
Euler is the limit of position-based solvers, vertex block descent and Newton's method of the backends with more
iterations. It minimises (S. Martin et al., "Example-Based Elastic Materials", ACM TOG 2011, eq. 3)

 sum of m |x - (x_0 + h v_0 + h^2 (g + f/m))|^2 / (2 h^2)  +  energy(x)  +  sum of V tau / (2 h) (E - E_0) : C : (E - E_0),

the last term for damping in proportion to the rate of Green's strain E = (F'F - I) / 2, with C the moduli of Hooke's
law. Rotations are not damped; a small vibration of angular frequency w has the damping ratio tau w / 2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from softlab.bench.reference import elastic_materials
from softlab.bench.reference.finite_elements import Body, Values, free_coordinates, lumped_mass

ENOUGH = 1e-10  # residual force relative to the load
MOST = 300  # largest number of Newton steps
DOWNHILL = 1e-4  # fraction of the linear prediction of the descent (Armijo)


def _step(matrix: sparse.csc_matrix, force: np.ndarray) -> np.ndarray | None:
    """Return the Newton step, or None if the matrix is singular or the step is not a descent direction."""
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
    watch: Callable[[np.ndarray], None] | None = None,
) -> np.ndarray:
    """Return the minimum (n, 3) from `start` (n, 3), with a force [N] on free coordinates of norm at most `enough`.

    `watch(x)` is called after each Newton step.
    `stiffness(x, positive)`: (3 n, 3 n), projected only where the exact one gives an ascent direction. Raises
    RuntimeError if it fails.
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
        promised, fraction = float(step @ pull), 1.0
        while True:
            trial = x.copy()
            trial.reshape(-1)[free] += fraction * step
            there, left = energy(trial), force(trial).ravel()[free]
            if there <= here - DOWNHILL * fraction * promised:
                break
            # near the end the descent is below the rounding of the energy, so the forces decide
            small = fraction * np.abs(step).max() <= 1e-6 * np.ptp(x)
            if small and np.linalg.norm(left) < 0.5 * np.linalg.norm(pull):
                break
            fraction /= 2
            if fraction < 1e-12:
                raise RuntimeError(f"Newton's method: no way down, {np.linalg.norm(pull):.2e} N left of {enough:.2e} N")
        x, here, pull = trial, there, left
        if watch:
            watch(x)
    raise RuntimeError(f"Newton's method: {np.linalg.norm(pull):.2e} N left of {enough:.2e} N after {MOST} steps")


def rounding(body: Body) -> float:
    """Norm [N] of the nodal forces due to the rounding of positions in float64, a lower bound for any solver."""
    extent = float(np.abs(body.rest).max())
    stiff = np.linalg.norm(body.stiffness().diagonal())
    return float(np.finfo(np.float64).eps * extent * stiff)


def nonlinear_static(
    body: Body,
    fixed: np.ndarray,
    force: np.ndarray | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    density: Values = 0.0,
    load_steps: int = 1,
    start: np.ndarray | None = None,
    enough: float = ENOUGH,
    watch: Callable[[np.ndarray], None] | None = None,
) -> np.ndarray:
    """Return positions (n, 3) [m] in equilibrium under `force` (n, 3) [N] and `gravity` [m/s^2] on lumped masses.

    From `start` (default: rest), with `fixed` vertices fixed. Residual forces are at most `enough` of the load, or the
    rounding of float64. `watch`: as `minimise` calls it.
    """
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
        x = minimise(potential, total, body.stiffness, x, fixed, near, watch)
    return x


class Damper:
    """Damping of a step from `before` (n, 3), by the rate of strain of each tetrahedron times `gamma` = tau / h."""

    def __init__(self, body: Body, before: np.ndarray, gamma: float) -> None:
        self.body, self.start = body, self._strain(body.deformation(before))
        self.moduli = gamma * elastic_materials.linear_tangent(body.mu, body.lam)  # (m, 9, 9), for symmetric matrices

    @staticmethod
    def _strain(gradient: np.ndarray) -> np.ndarray:
        return (np.einsum("mki,mkj->mij", gradient, gradient) - np.eye(3)) / 2

    def _change(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (F, E - E_0, the second Piola-Kirchhoff stress [Pa]), (m, 3, 3) each."""
        gradient = self.body.deformation(x)
        change = self._strain(gradient) - self.start
        return gradient, change, (self.moduli @ change.reshape(-1, 9, 1)).reshape(-1, 3, 3)

    def energy(self, x: np.ndarray) -> float:
        _, change, pull = self._change(x)
        return float(self.body.volume @ (change * pull).sum(axis=(1, 2))) / 2

    def force(self, x: np.ndarray) -> np.ndarray:
        """Return the negative gradient of the energy: (n, 3) [N]."""
        gradient, _, pull = self._change(x)
        each = -np.einsum("m,mij,maj->mai", self.body.volume, gradient @ pull, self.body.gradient)
        force = np.zeros_like(x)
        np.add.at(force, self.body.tetrahedra, each)
        return force

    def stiffness(self, x: np.ndarray, positive: bool) -> sparse.csc_matrix:
        """Return the second derivatives (3 n, 3 n) [N/m]; `positive`: the stress term only where it is tensile."""
        gradient, _, pull = self._change(x)
        if positive:
            values, vectors = np.linalg.eigh(pull)
            pull = np.einsum("mij,mj,mkj->mik", vectors, np.maximum(values, 0), vectors)
        moduli = self.moduli.reshape(-1, 3, 3, 3, 3)
        tangent = np.einsum("mia,majbl,mkb->mijkl", gradient, moduli, gradient, optimize=True)
        tangent = tangent + np.einsum("ik,mjl->mijkl", np.eye(3), pull)
        return self.body.assembled(tangent.reshape(-1, 9, 9))


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
    """Return (position [m], velocity [m/s]), (n, 3) each, after one converged step `h` [s] of backward Euler.

    Residual forces are at most `enough` of the inertia's h^2 (or the rounding of float64). `damping_time`: tau [s]
    above. `fixed` vertices stay.
    """
    before = np.array(position, dtype=np.float64)
    damper = Damper(body, before, damping_time / h) if damping_time > 0 else None
    push = np.zeros_like(before) if force is None else np.asarray(force, dtype=np.float64)
    aim = before + h * velocity + h**2 * (np.asarray(gravity) + push / mass[:, None])
    weight = np.repeat(mass / h**2, 3)
    inertia = sparse.diags(weight).tocsc()

    def energy(x: np.ndarray) -> float:
        lost = damper.energy(x) if damper else 0.0
        return float(weight @ (x - aim).ravel() ** 2) / 2 + body.energy(x) + lost

    def total(x: np.ndarray) -> np.ndarray:
        pull = body.force(x) - weight.reshape(-1, 3) * (x - aim)
        return pull + damper.force(x) if damper else pull

    def stiffness(x: np.ndarray, positive: bool) -> sparse.csc_matrix:
        matrix = inertia + body.stiffness(x, positive)
        return matrix + damper.stiffness(x, positive) if damper else matrix

    free = free_coordinates(fixed)
    size = max(np.linalg.norm(total(before).ravel()[free]), np.linalg.norm((weight * (aim - before).ravel())[free]))
    x = minimise(
        energy, total, stiffness, before, fixed, max(enough * float(size), rounding(body)),
    )  # fmt: skip
    return x, (x - before) / h
