"""A pull by the mouse on a body: a force at one of its particles, spread over its neighbours, strong enough for the
whole body.

A force on one particle cannot carry its body: at a stiffness of w^2 the particle would be displaced by M g / (m w^2),
metres for the jellies of the catalogue. So the force is spread around the particle, by mass and by (1 -
d^2/radius^2)^2, and applied as a change of velocity through the state. The kernels are unchanged, and any number of
particles can take part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softlab.model.core.simulation import Simulation

HAND = 10.0  # 1/s: the angular frequency at which a body follows the pointer, where nothing below asks for less
PULL_RADIUS = 0.5  # of the body's longest side, to where a pull is shared
MIN_PULL_RADIUS = 2.5  # particle spacings
GIVE = 0.1  # of its longest side: how far the pulled part may leave the rest of the body
CALMING = 3.0  # 1/s, at which the rest of a held body comes to move as its held part does: else it swings on and on
STEADY, SLOWING = 0.2, 0.5  # of what would overturn the part's motion in the time for which a force is held


class MouseConstraint:
    """A pull on the body of `particle`: the pulled `particles` (n,) and their `weights` (n,) of the force, whose sum is 1."""

    def __init__(self, world: Simulation, particle: int):
        body_set, self.particle = world.scene.body_set, particle
        clusters, body = body_set.clusters, body_set.body[particle]
        self._body_particles = body_particles = np.flatnonzero(body_set.body == body)
        rest, mass = body_set.position[body_particles], clusters.mass[body_particles]
        self.mass, self.extent = float(mass.sum()), float(np.ptp(rest, axis=0).max())
        spacing = body_set.copies[body].baked.spacing
        radius = max(PULL_RADIUS * self.extent, MIN_PULL_RADIUS * spacing)
        self.extent = max(self.extent, spacing)
        away = np.linalg.norm(rest - body_set.position[particle], axis=1) / radius
        weights = mass * np.clip(1 - away * away, 0, None) ** 2
        self.particles, self.weights = body_particles[weights > 0], weights[weights > 0] / weights.sum()
        self._push = (self.weights / clusters.mass[self.particles])[:, None]  # 1/kg
        self._part = float(1 / np.sum(self.weights * self._push[:, 0]))  # kg, moved by a pull before the body follows
        entries = np.flatnonzero(clusters.indices == particle)
        stiffness = clusters.stiffness[clusters.owner[entries]]
        self._softest = float(stiffness.min(initial=np.inf))  # 1/s^2
        self._velocity = np.zeros(3)

    def stiffness(self, interval: float) -> float:
        """Return the stiffness [N/m] of a force that is constant for `interval` [s]."""
        yielding = GIVE * self._part * self._softest
        return min(self.mass * HAND**2, yielding, STEADY * self._part / interval**2)

    def force(
        self,
        world: Simulation,
        place: np.ndarray,
        target: Sequence[float] | None,
        direction: Sequence[float],
        interval: float,
    ) -> np.ndarray:
        """Return the force (3,) [N] from the particle at `place` [m] to `target` [m].

        It is critically damped for the body's mass, the distance counts at most as the body's length, and balances its
        weight; without a target it is half of that limit, along `direction`.
        """
        gain = self.stiffness(interval)
        if target is None:
            return gain * self.extent / 2 * np.asarray(direction)
        away = np.asarray(target, dtype=np.float64) - place
        far = float(np.linalg.norm(away))
        if far > self.extent:
            away *= self.extent / far
        damping = min(2 * np.sqrt(gain * self.mass), SLOWING * self._part / interval)
        gravity = world.scene.gravity
        weight = self.mass * gravity.acceleration if gravity is not None and gravity.enabled else 0.0
        return gain * away - damping * self._velocity + np.array([0.0, weight, 0.0])

    def pull(
        self, world: Simulation, target: Sequence[float] | None, direction: Sequence[float], interval: float
    ) -> None:
        """Apply the force's impulse over `interval` [s] to the world. Raises Diverged."""
        state = world.state()
        velocity = state.velocity.copy()
        self._velocity = self.weights @ velocity[self.particles].astype(np.float64)
        place = state.position[self.particle].astype(np.float64)
        force = self.force(world, place, target, direction, interval)
        if np.isfinite(force).all():
            calming = min(CALMING * interval, SLOWING)
            velocity[self._body_particles] -= calming * (velocity[self._body_particles] - self._velocity)
            velocity[self.particles] += interval * self._push * force
            world.load(replace(state, velocity=velocity, inverse_mass=world.body.inverse_mass))
