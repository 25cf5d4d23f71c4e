"""Spare copies of bodies, which are inactive and weightless until they are activated while a scene runs."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.core.simulation import STILL
from softlab.model.core.state import State
from softlab.model.particles.body_set import Copy
from softlab.model.scene.scene import Scene


def waiting(scene: Scene, inverse_mass: np.ndarray) -> np.ndarray | None:
    """Return which particles belong to inactive copies, (particles,) bool: their `inverse_mass` [1/kg] is 0.

    None if the inverse masses are not those of the scene, or 0 for only a part of a copy.
    """
    body_set, waits = scene.body_set, inverse_mass == 0
    known = np.where(waits, 0.0, 1 / body_set.clusters.mass)
    fraction = np.bincount(body_set.body, waits) / np.bincount(body_set.body)
    return waits if np.allclose(inverse_mass, known, rtol=1e-6, atol=0) and np.isin(fraction, (0, 1)).all() else None


def weights(scene: Scene, parts: frozenset[str], inverse_mass: np.ndarray) -> np.ndarray:
    """Return the inverse masses [1/kg] with the inactive particles of `inverse_mass`. Raises InputError if others
    differ."""
    waits = waiting(scene, inverse_mass) if "spare" in parts else None
    if waits is None:
        raise InputError("inverse_mass differs from the scene's; give the scene the same masses and pins")
    return np.where(waits, 0.0, 1 / scene.body_set.clusters.mass)


def added(
    scene: Scene, state: State, name: str, origin: Sequence[float] | None, velocity: Sequence[float]
) -> tuple[int, State]:
    """Return the number of the copy, and the state with it; see Simulation.add_body."""
    weights = state.inverse_mass
    if name not in scene.bodies:
        raise SceneError("body", name, f"must be one of {', '.join(scene.bodies) or 'a scene with bodies'}")
    part, copies = scene.bodies[name], [copy for copy in scene.copies if copy.name == name]
    copy = next((one for one in copies if not weights[one.first_particle]), None)
    if copy is None:
        reason = "all spare copies are in use; raise `spare` or call remove_body() first"
        raise SceneError(f"{name}.spare", part.spare, reason)
    for field, value in (("origin", origin), ("velocity", velocity)):
        array = np.asarray(value if value is not None else STILL)
        if array.shape != (3,) or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
            raise SceneError(field, value, "must be three finite numbers, x first")
    moved = np.subtract(part.places()[0] if origin is None else origin, part.places()[0])
    return copy.number, _put(scene, state, copy, scene.body_set.position[copies[0].particles] + moved, velocity, True)


def removed(scene: Scene, state: State, parts: Collection[str], number: int) -> State:
    """Return the state without the copy, see Simulation.remove_body; `parts`: parts of the plan."""
    weights = state.inverse_mass
    copies = scene.copies
    if (
        not isinstance(number, int | np.integer)
        or not 0 <= number < len(copies)
        or not weights[copies[number].first_particle]
    ):
        raise SceneError("body", number, "there is no such body now")
    copy = copies[number]
    if "spare" not in parts:
        raise SceneError(f"{copy.name}.spare", 0, "must be at least 1 in a scene from which bodies are removed")
    return _put(scene, state, copy, scene.body_set.position[copy.particles], STILL, False)


def _put(scene: Scene, state: State, copy: Copy, position: np.ndarray, velocity: Sequence[float], there: bool) -> State:
    """Return the state, modified in place, with a copy in its rest shape at `position`, active or inactive."""
    body_set = scene.body_set
    clusters = slice(copy.first_cluster, copy.first_cluster + copy.baked.clusters.count)
    state.position[copy.particles], state.velocity[copy.particles] = position, velocity
    state.inverse_mass[copy.particles] = 1 / body_set.clusters.mass[copy.particles] if there else 0.0
    if state.rotation is not None:
        state.rotation[clusters] = (1.0, 0.0, 0.0, 0.0)
    if state.plastic is not None:
        state.plastic[clusters] = np.eye(3)
    return state
