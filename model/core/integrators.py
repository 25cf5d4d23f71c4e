"""Properties of each integrator: its order, its cost, its largest stable step size.

The limits are those of the linear test equation x'' = -w^2 x - gamma x' at the largest w of the scene. They apply to
nonlinear motion as far as frozen coefficients do (the bound on w is valid in any state of the grid, see
`frequency_bound`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from softlab.model.base.variant import check_returns
from softlab.model.core.build import pinned_indices
from softlab.model.core.stability.cloth_bounds import laplacian_bound
from softlab.model.formulas import integrators
from softlab.model.particles.particle_set import ParticleSet
from softlab.model.scene.scene import Scene


def _lab_limit(w: float, gamma: float) -> float:
    """dt^2 w^2 + 2 dt gamma < 8 (and dt gamma < 4, which the first implies unless w = 0)."""
    if w == 0:
        return 4 / gamma if gamma else inf
    return 8 / (gamma + sqrt(gamma * gamma + 8 * w * w))


def _semi_implicit_limit(w: float, gamma: float) -> float:
    """dt^2 w^2 + 2 dt gamma < 4 (and dt gamma < 2)."""
    if w == 0:
        return 2 / gamma if gamma else inf
    return 4 / (gamma + sqrt(gamma * gamma + 4 * w * w))


def _verlet_limit(w: float, gamma: float) -> float:
    """dt w < 2, at any damping, because the damper is implicit in the second half kick."""
    return 2 / w if w else inf


def _explicit_limit(w: float, gamma: float, taylor: bool) -> float:
    """dt < gamma / w^2 (Euler) or 2 gamma / w^2 (taylor), and the damper's own dt gamma < 2.

    An overdamped mode has real roots, for which Euler needs dt * larger < 2. A slower mode of the same scene may be
    overdamped while the fastest is not, so the limit is the smallest over all frequencies from 0 to w.
    """
    if gamma == 0:
        return inf if w == 0 else 0.0
    bound = 2 / gamma  # from the mode w -> 0, whose velocity decays at gamma
    if w == 0:
        return bound
    if taylor:
        return min(bound, 2 * gamma / (w * w))
    return min(bound, gamma / (w * w))


def _rk4_limit(w: float, gamma: float) -> float:
    """|R(dt lambda)| <= 1 for both roots lambda of every mode up to w; no closed form, computed by bisection."""
    if w == 0 and gamma == 0:
        return inf
    frequencies = np.append(np.linspace(0, w, 65), w)
    root = np.sqrt((gamma * gamma / 4 - frequencies**2).astype(complex))
    eigenvalues = np.concatenate([-gamma / 2 + root, -gamma / 2 - root])

    def holds(dt: float) -> bool:
        z = dt * eigenvalues
        return bool(np.all(np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24) <= 1 + 1e-13))

    high = 4 / max(w, gamma)  # unstable: the stability region ends at |z| = 2.83
    low = 0.25 * high
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


@dataclass(frozen=True)
class Integrator:
    """Properties of an integrator.

    `order`: of the error at a fixed time against Newton's law. `forces`: force evaluations per step, 0 where the state
    decides. `limit(w, gamma)`: the largest stable dt [s] at angular frequency w [1/s] and damping rate gamma =
    coefficient / mass [1/s]. `operations`: floating-point operations per axis and step, without the forces. `step`: the
    formula, if it is all of a step after one evaluation of the forces.
    """

    name: str
    order: int
    forces: int
    limit: Callable[[float, float], float]
    note: str
    operations: int = 0
    step: Callable | None = None

    def __post_init__(self) -> None:
        if self.step is not None:
            check_returns(self.step, 2)


INTEGRATORS = {  # for every sheet
    entry.name: entry
    for entry in (
        Integrator(
            "lab",
            0,
            1,
            _lab_limit,
            "the hand-out's step: half the acceleration, order 1 against that",
            6,
            integrators.lab,
        ),
        Integrator("semi-implicit-euler", 1, 1, _semi_implicit_limit, "symplectic", 4, integrators.semi_implicit_euler),
        Integrator("velocity-verlet", 2, 1, _verlet_limit, "symplectic; damping implicit in the second half kick", 9),
        Integrator("rk4", 4, 4, _rk4_limit, "four forces a step; loses energy slowly", 28),
        Integrator(
            "explicit-euler",
            1,
            1,
            lambda w, g: _explicit_limit(w, g, False),
            "gains energy",
            4,
            integrators.explicit_euler,
        ),
        Integrator(
            "taylor",
            1,
            1,
            lambda w, g: _explicit_limit(w, g, True),
            "the compute-shader cloth's step",
            6,
            integrators.taylor,
        ),
    )
}


def _no_limit(w: float, gamma: float) -> float:
    """Return inf: no eigenvalue of the step exceeds 1 at any dt, w and gamma."""
    return inf


IMPLICIT = {  # for cloths
    entry.name: entry
    for entry in (
        Integrator("implicit-euler", 1, 0, _no_limit, "Newton's method to 1e-8; loses energy; wind and poke explicit"),
        Integrator(
            "implicit-euler-linear", 1, 0, _no_limit, "one linearised step (Baraff and Witkin 1998); loses energy"
        ),
    )
}


def step_formula(integrator: str) -> Callable:
    """Return the formula of an integrator's step; of integrators in several passes semi-implicit Euler, which they do
    not call."""
    entry = (INTEGRATORS | IMPLICIT)[integrator]
    return integrators.semi_implicit_euler if entry.step is None else entry.step


def integrators_for(scene: Scene) -> dict[str, Integrator]:
    """Return the integrators that can step the scene's sheet, by name."""
    return INTEGRATORS | IMPLICIT if scene.cloth else INTEGRATORS


def amplification_matrix(integrator: str, dt: float, w: float, gamma: float) -> np.ndarray:
    """Return one step of x'' = -w^2 x - gamma x' as a (2, 2) matrix on (x, v): the definition for the tests of the
    limits."""

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -w * w * x - gamma * v

    x, v = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    a = acceleration(x, v)
    if integrator == "lab":
        new_x = x + v * dt + a * dt**2 / 2
        new_v = (new_x - x) / dt
    elif integrator == "semi-implicit-euler":
        new_v = v + a * dt
        new_x = x + new_v * dt
    elif integrator == "explicit-euler":
        new_x, new_v = x + v * dt, v + a * dt
    elif integrator == "taylor":
        new_x, new_v = x + v * dt + a * dt**2 / 2, v + a * dt
    elif integrator == "velocity-verlet":
        half = v + dt / 2 * a
        new_x = x + dt * half
        new_v = (half - dt / 2 * w * w * new_x) / (1 + dt * gamma / 2)
    elif integrator in IMPLICIT:
        new_v = (v - dt * w * w * x) / (1 + dt * gamma + dt * dt * w * w)
        new_x = x + dt * new_v
    elif integrator == "rk4":
        matrix = dt * np.array([[0.0, 1.0], [-w * w, -gamma]])
        power, result = np.eye(2), np.eye(2)
        for k in range(1, 5):
            power = power @ matrix / k
            result = result + power
        return result
    else:
        raise KeyError(integrator)
    return np.array([new_x, new_v])


def frequency_bound(scene: Scene) -> float:
    """Return an angular frequency [1/s] that no vibration of the scene exceeds, in any state of the grid.

    A spring's stiffness matrix has no eigenvalue above k in any state, so w^2 <= k/m times the largest eigenvalue of
    the grid's Laplacian, which is at most twice the largest number of springs on one mass (Gershgorin): 8 k/m inside a
    grid. Where springs alternate, k is the stiffest one's; where masses differ, m is the lightest one.
    model/core/stability/limit.py computes the frequency of the net itself. A cloth's bound is in
    model/core/stability/cloth_bounds.py. No bound is known for a mesh from a file and for bodies, whose solvers have no
    limit that depends on it.
    """
    if scene.cloth:
        return sqrt(laplacian_bound(scene, "stiffness") / lightest_mass(scene))
    grid, springs = scene.grid, scene.springs
    if springs is None:
        return 0.0
    most_springs = min(grid.rows - 1, 2) + min(grid.columns - 1, 2)
    return sqrt(2 * most_springs * springs.largest_stiffness / lightest_mass(scene))


def lightest_mass(scene: Scene) -> float:
    """Return the smallest mass [kg] that moves, or of inactive bodies may; the sheet's where nothing moves."""
    sheet = scene.grid
    if isinstance(sheet, ParticleSet):
        return sheet.lightest
    by_area = sheet.masses_by_area()
    if not scene.loads and by_area is None:
        return sheet.mass
    pinned = pinned_indices(sheet)
    loads = {load.at[0] * sheet.columns + load.at[1]: load.mass for load in scene.loads.values()}
    excluded = np.union1d(pinned, np.array([*loads], np.int64))
    candidates = [mass for place, mass in loads.items() if place not in pinned]
    if by_area is not None:
        candidates.append(float(np.delete(by_area, excluded).min(initial=inf)))
    elif len(excluded) < sheet.particle_count:
        candidates.append(sheet.mass)
    return min((mass for mass in candidates if mass < inf), default=sheet.mass)


def damping_rate(scene: Scene) -> float:
    """Return coefficient / mass [1/s] for the sheet's mass, or the mean mass; 0 where the scene has no damping."""
    return scene.damping.coefficient / scene.grid.mass if scene.damping else 0.0


def fastest_damping(scene: Scene) -> float:
    """Return coefficient / mass [1/s] for the lightest mass: no damper reduces a velocity faster."""
    return scene.damping.coefficient / lightest_mass(scene) if scene.damping else 0.0


def spring_damping_bound(scene: Scene) -> float:
    """Return a rate [1/s] that the dampers along a cloth's springs do not exceed; 0 for a grid, which has none.

    Their matrix is a Laplacian, bounded like the springs' (see `frequency_bound`).
    """
    return laplacian_bound(scene, "damping") / scene.grid.mass


def explicit_limit(scene: Scene, frequency: float | None = None) -> float:
    """Return the largest step size [s] at which the scene's integrator is stable for any state of the sheet (may be inf
    or 0).

    `frequency` [1/s]: an upper bound of all vibrations, where a better one is known than `frequency_bound`. Every
    explicit integrator evaluates dampers along springs at the step's start; velocity Verlet then has the limit of
    semi-implicit Euler. A mode has anything from none to all of their rate. Wind is omitted: it only damps, weakly for
    cloth that is heavier than the air it moves in a step.
    """
    name, gamma = scene.method.integrator, damping_rate(scene)
    w = frequency_bound(scene) if frequency is None else frequency
    limit = integrators_for(scene)[name].limit
    along = spring_damping_bound(scene)
    if along == 0:
        return limit(w, gamma)
    if name == "velocity-verlet":
        return _semi_implicit_limit(w, along)
    return min(limit(w, gamma), limit(w, gamma + along))
