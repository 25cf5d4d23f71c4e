"""The hand on a body: a pull at one of its particles, which its neighbours share, as strong as the whole body needs.

One particle of many cannot carry its body: at a stiffness of w^2 it would leave its place by M g / (m w^2), metres for the
lab's jellies. So the force is spread about the particle, by mass and by (1 - d^2/reach^2)^2, and given as changes of
velocity, through the state: no kernel knows of it, and any number of particles can share it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softlab.model.core.simulation import Simulation

HAND = 10.0  # 1/s: the angular frequency at which a body follows the pointer, where nothing below asks for less
REACH = 0.5  # of the body's longest side, to where a pull is shared
MIN_REACH = 2.5  # particle spacings
GIVE = 0.1  # of its longest side: how far the pulled part may leave the rest of the body
CALMING = 3.0  # 1/s, at which the rest of a held body comes to move as its held part does: else it swings on and on
STEADY, SLOWING = 0.2, 0.5  # of what would overturn the part's motion in the time for which a force is held


class Grip:
    """What is held of the body of `particle`: `particles` (n,), their `share` (n,) of the force, which add up to 1."""

    def __init__(self, world: Simulation, particle: int):
        body_set, self.particle = world.scene.body_set, particle
        clusters, body = body_set.clusters, body_set.body[particle]
        self._own = own = np.flatnonzero(body_set.body == body)
        rest, mass = body_set.position[own], clusters.mass[own]
        self.mass, self.extent = float(mass.sum()), float(np.ptp(rest, axis=0).max())
        spacing = body_set.copies[body].baked.spacing
        reach = max(REACH * self.extent, MIN_REACH * spacing)
        self.extent = max(self.extent, spacing)
        away = np.linalg.norm(rest - body_set.position[particle], axis=1) / reach
        share = mass * np.clip(1 - away * away, 0, None) ** 2
        self.particles, self.share = own[share > 0], share[share > 0] / share.sum()
        self._push = (self.share / clusters.mass[self.particles])[:, None]  # 1/kg
        self._part = float(1 / np.sum(self.share * self._push[:, 0]))  # kg, what a pull moves before the body helps it
        entries = np.flatnonzero(clusters.indices == particle)
        stiffness = clusters.stiffness[clusters.owner[entries]]
        self._softest = float(stiffness.min(initial=np.inf))  # 1/s^2
        self._velocity = np.zeros(3)

    def stiffness(self, hold_time: float) -> float:
        """[N/m], of a force that is held for `hold_time` [s]."""
        yielding = GIVE * self._part * self._softest
        return min(self.mass * HAND**2, yielding, STEADY * self._part / hold_time**2)

    def force(
        self,
        world: Simulation,
        place: np.ndarray,
        target: Sequence[float] | None,
        way: Sequence[float],
        hold_time: float,
    ) -> np.ndarray:
        """(3,) [N]: from the particle at `place` [m] to `target` [m], critically damped for the body's mass, as if not
        further than the body is long, and against its weight; without a target half of that limit, in the direction `way`."""
        gain = self.stiffness(hold_time)
        if target is None:
            return gain * self.extent / 2 * np.asarray(way)
        away = np.asarray(target, dtype=np.float64) - place
        far = float(np.linalg.norm(away))
        if far > self.extent:
            away *= self.extent / far
        damping = min(2 * np.sqrt(gain * self.mass), SLOWING * self._part / hold_time)
        gravity = world.scene.gravity
        weight = self.mass * gravity.acceleration if gravity is not None and gravity.enabled else 0.0
        return gain * away - damping * self._velocity + np.array([0.0, weight, 0.0])

    def pull(self, world: Simulation, target: Sequence[float] | None, way: Sequence[float], hold_time: float) -> None:
        """Give the world the force's impulse of `hold_time` [s]. Raises Diverged."""
        state = world.state()
        velocity = state.velocity.copy()
        self._velocity = self.share @ velocity[self.particles].astype(np.float64)
        place = state.position[self.particle].astype(np.float64)
        force = self.force(world, place, target, way, hold_time)
        if np.isfinite(force).all():
            velocity[self._own] -= min(CALMING * hold_time, SLOWING) * (velocity[self._own] - self._velocity)
            velocity[self.particles] += hold_time * self._push * force
            world.load(replace(state, velocity=velocity, inverse_mass=world.body.inverse_mass))
