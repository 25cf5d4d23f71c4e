"""Small scenes for vertex block descent, and what judges it: the energy of a step of backward Euler in plain NumPy, and where
that is least by Newton's method with derivatives by differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from tetrahedra_scenes import moving

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.particles.tetrahedra_set import TetrahedraSet
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.material import deformation, energies, rest_ratio

METHOD = {"solver": "vbd", "dt": 0.01, "substeps": 1, "iterations": 2}
BODY: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]}, "edge": 0.1,
    "young_modulus": 2e4, "poisson_ratio": 0.3, "pinned": ["left"],
}  # fmt: skip
FREE = BODY | {"pinned": [], "origin": [0.0, 0.3, 0.0], "velocity": [0.2, -0.1, 0.3], "spin": [3.0, 1.0, -2.0]}
EVERYTHING: dict[str, Any] = {
    "body": BODY | {"damping": 0.02},
    "second": FREE | {"material": "neo-hookean", "young_modulus": 5e4, "origin": [0.0, 0.05, 0.3]},
    "third": FREE | {"material": "corotated", "origin": [0.5, 0.2, 0.0], "angle": 30.0},
    "gravity": {}, "damping": {"coefficient": 0.01}, "external": {"magnitude": 0.02, "seed": 5},
    "plane": {"point": [0.0, -0.04, 0.0], "static_friction": 0.4, "dynamic_friction": 0.3},
    "method": METHOD | {"substeps": 2},
}  # fmt: skip
POKE = (9, (0.05, -0.02, 0.1))  # particle, N


def vbd_scene(body: dict[str, Any] = BODY, gravity: float = 9.81, **method: Any) -> Scene:
    """One body; `method`: other fields of it."""
    tables: dict[str, Any] = {"body": body, "method": METHOD | method}
    return Scene(tables | ({"gravity": {"acceleration": gravity}} if gravity else {}), "vbd")


def end_state(scene: Scene, steps: int = 1, start: State | None = None, backend: str = "cpu", **options: Any) -> State:
    """After `steps` steps from `moving`, or from `start`; in float64 and exact math unless told."""
    options = {"precision": "float64", "math": "exact", "threads": 1} | options
    with open_simulation(scene, backend, initial=start or moving(scene), **options) as simulation:
        simulation.advance(steps)
        return simulation.state()


# ---------------------------------------------------------------------- the judge


def stress_of(material: str, f: np.ndarray, mu: float, lame: float) -> np.ndarray:
    """(3, 3): P of one F, by singular values."""
    u, s, w = np.linalg.svd(f)
    sign = np.sign(np.linalg.det(f)) or 1.0
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ w)]) @ w
    cofactors = np.stack([np.cross(f[:, 1], f[:, 2]), np.cross(f[:, 2], f[:, 0]), np.cross(f[:, 0], f[:, 1])], axis=1)
    volume_ratio = np.linalg.det(f)
    if material == "neo-hookean":
        return mu * f + (lame + mu) * (volume_ratio - float(rest_ratio(mu, lame))) * cofactors  # type: ignore[arg-type]
    if material == "corotated":
        return 2 * mu * (f - turn) + lame * (s[0] + s[1] + sign * s[2] - 3) * turn
    return 2 * mu * (f - turn) + lame * (volume_ratio - 1) * cofactors


def elastic_force(found: TetrahedraSet, position: np.ndarray) -> np.ndarray:
    """(particles, 3) [N]: minus the derivative of the energy."""
    force = np.zeros_like(position)
    for number, f in enumerate(deformation(found, position)):
        part, b = found.parts[found.body[number]], found.rest_inverse[number]
        each = -found.volume[number] * stress_of(part.material, f, *part.lame) @ np.vstack([-b.sum(axis=0), b]).T
        np.add.at(force, found.tetrahedra[number], each.T)
    return force


def free_fall(scene: Scene, begin: State) -> np.ndarray:
    """(particles, 3): y of the first substep, of a scene with nothing but gravity."""
    h = scene.method.dt / scene.method.substeps
    gravity = scene.gravity.acceleration if scene.gravity else 0.0
    free = (begin.inverse_mass > 0)[:, None]
    return begin.position + free * (h * begin.velocity - h**2 * np.array([0.0, gravity, 0.0]))


def step_energy(scene: Scene, begin: State) -> Callable[[np.ndarray], float]:
    """What a step of backward Euler makes least [J]."""
    found, h, y = scene.tetrahedra_set, scene.method.dt / scene.method.substeps, free_fall(scene, begin)

    def energy(x: np.ndarray) -> float:
        return float((found.masses[:, None] * (x - y) ** 2).sum() / (2 * h**2) + energies(found, x).sum())

    return energy


def step_slope(scene: Scene, begin: State) -> Callable[[np.ndarray], np.ndarray]:
    """Its derivative (particles, 3) [N], 0 where nothing moves."""
    found, h, y = scene.tetrahedra_set, scene.method.dt / scene.method.substeps, free_fall(scene, begin)
    free = (begin.inverse_mass > 0)[:, None]
    return lambda x: free * (found.masses[:, None] * (x - y) / h**2 - elastic_force(found, x))


def zero_of(slope: Callable[[np.ndarray], np.ndarray], start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Where a derivative is 0, by Newton's method with central differences; `free` (particles,) bool: what moves."""
    x, places, step = start.copy(), np.flatnonzero(np.repeat(free, 3)), 1e-6
    for _ in range(30):
        left = slope(x).ravel()[places]
        columns = []
        for place in places:
            away = np.zeros(x.size)
            away[place] = step
            both = [slope(x + sign * away.reshape(x.shape)).ravel()[places] for sign in (1, -1)]
            columns.append((both[0] - both[1]) / (2 * step))
        change = np.zeros(x.size)
        change[places] = np.linalg.solve(np.array(columns).T, left)
        x = x - change.reshape(x.shape)
        if np.abs(change).max() < 1e-13:
            return x
    raise AssertionError(f"Newton's method still moves {np.abs(change).max():.1e} m")
