"""Active particles of a scene: all but those of spare copies of bodies and those that wait for an emitter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.particles.body_set import BodySet
from softlab.model.particles.fluid_set import FluidSet
from softlab.model.scene.scene import Scene
from softlab.model.tables.flow import nozzle_points


def inactive(scene: Scene, inverse_mass: np.ndarray | None = None) -> np.ndarray | None:
    """Return the inactive particles of bodies and fluids, (particles,) bool; None where there are none.

    By inverse masses as in State or (None) at the scene's start.
    """
    particles = scene.grid
    if not isinstance(particles, BodySet | FluidSet):
        return None
    waits = particles.waiting if inverse_mass is None else np.asarray(inverse_mass) == 0
    return waits if waits.any() else None


def present(scene: Scene, position: np.ndarray, inverse_mass: np.ndarray | None = None) -> np.ndarray:
    """Return the `position` (particles, dimensions) of active particles by `inactive`, of fluids by position.

    All, where none would be left, or for a fluid its nozzles.
    """
    if scene.flows:
        there = position[scene.fluid_set.there(position)]
        return there if len(there) else nozzle_points(scene, np.float64)[:, : position.shape[1]]
    waits = inactive(scene, inverse_mass)
    return position if waits is None or waits.all() else position[~waits]


def copies_there(scene: Scene, inverse_mass: np.ndarray | None = None) -> np.ndarray:
    """Return which copies of a scene's bodies are active by `inactive`, (copies,) bool."""
    waits = inactive(scene, inverse_mass)
    return np.array([waits is None or not waits[copy.first_particle] for copy in scene.copies])


@dataclass(frozen=True)
class Counts:
    """Numbers of active particles, clusters and bodies, and of inactive bodies and their particles.

    All masses of a sheet are active, and it has no bodies.
    """

    particles: int
    clusters: int = 0
    bodies: int = 0
    waiting: int = 0
    waiting_particles: int = 0


def counts(scene: Scene, inverse_mass: np.ndarray | None = None) -> Counts:
    """Return the numbers of active and inactive particles and bodies, by `inactive`."""
    if not scene.copies:
        waits = inactive(scene, inverse_mass)
        waiting_particles = 0 if waits is None else int(waits.sum())
        return Counts(scene.grid.particle_count - waiting_particles, waiting_particles=waiting_particles)
    is_there = copies_there(scene, inverse_mass)
    there = [copy.baked for copy in scene.copies if is_there[copy.number]]
    waiting = [copy.baked for copy in scene.copies if not is_there[copy.number]]
    return Counts(
        sum(len(body.position) for body in there), sum(body.clusters.count for body in there), len(there), len(waiting),
        sum(len(body.position) for body in waiting),
    )  # fmt: skip
