"""Contacts between particles in NumPy, float64, all pairs by brute force, without the lab's formulas or records.

model/tables/particle_contact.py describes them, model/formulas/particle_contact.py has the sources.
"""

from __future__ import annotations

import numpy as np

from softlab.model.scene.scene import Scene

MARGIN = 0.2  # of the distance: margin of the neighbour search
BESIDE = 1.001  # of the distance: particles nearer than this at the end of the substep are in contact
LEFT = 2.0**-8  # of the speed at which bodies settle: largest speed of separation of two that were pushed apart
REST = 1.25  # of the distance: particles of one body nearer than this at rest have no contact


class Contacts:
    """Contacts of a scene's bodies; `weight` (particles,): inverse masses [1/kg], which may be 0."""

    def __init__(self, scene: Scene):
        part, body_set = scene.contact, scene.body_set
        assert part is not None
        self.part, self.weight, self.h = part, 1 / body_set.clusters.mass, scene.method.dt / scene.method.substeps
        bodies = [scene.bodies[copy.name] for copy in body_set.copies]
        radius = np.array([body.contact_radius for body in bodies])[body_set.body]
        sticky = np.array([body.adhesion for body in bodies])[body_set.body]
        same_body = body_set.body[:, None] == body_set.body
        self.distance = radius[:, None] + radius
        groups_collide = np.array(
            [[a.group not in b.avoids and b.group not in a.avoids for a in bodies] for b in bodies]
        )
        self.colliding = groups_collide[np.ix_(body_set.body, body_set.body)] & ~same_body
        itself = np.array([body.self_colliding for body in bodies])[body_set.body]
        rest = np.linalg.norm(body_set.position[:, None] - body_set.position, axis=2)
        self.colliding |= same_body & itself[:, None] & (rest >= REST * self.distance)
        np.fill_diagonal(self.colliding, False)
        projections = scene.method.iterations * part.sweeps
        self.pull = np.where(same_body, 0.0, np.maximum(sticky[:, None], sticky)) * self.h**2 / projections
        self.active = self.distance * (1 + part.adhesion_reach * (self.pull > 0))
        self.gravity = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
        self.pairs = np.zeros((0, 2), np.int64)
        self.pressed = np.zeros((0, 0))  # accumulated push of pairs (i, j) in the substep so far, times h
        self.asked = np.zeros(len(body_set.position))
        self.couples = np.zeros_like(body_set.position)  # of the substep so far, per unit of mass, times h

    def find(self, predicted: np.ndarray) -> None:
        """Store the pairs that may have contact within the substep, each once; `predicted` (particles, 3) [m]."""
        between = np.linalg.norm(predicted[:, None] - predicted, axis=2)
        self.couples[:] = 0.0
        self.pressed = np.zeros((len(predicted), len(predicted)))
        one, other = np.nonzero(np.triu(self.colliding & (between < self.active * (1 + MARGIN))))
        self.pairs = np.stack([one, other], axis=1)

    def sweep(self, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return the positions [m] after all sweeps of an iteration."""
        for _ in range(self.part.sweeps):
            now = self.project(before, now)
        return now

    def project(self, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return the positions [m] after one sweep over all contacts at once; `before` is the start of the substep.

        No two particles may coincide.
        """
        i, j = self.pairs.T
        d = now[i] - now[j]
        length = np.linalg.norm(d, axis=1)
        touching = length < self.active[i, j]
        i, j, d, length = i[touching], j[touching], d[touching], length[touching]
        contacts = np.bincount(np.concatenate([i, j]), minlength=len(now))
        stiffness = self.weight[i] * contacts[i] + self.weight[j] * contacts[j]
        normal = d / length[:, None]
        distance, pull, b = self.distance[i, j], self.pull[i, j], before[i] - before[j]
        required = np.minimum(distance, np.linalg.norm(b, axis=1) + self.part.separation_speed * self.h)
        depth = np.where(length < required, required - length, np.clip(distance - length, -pull, 0.0))
        slip = (d - b) - ((d - b) * normal).sum(axis=1)[:, None] * normal
        sliding, pressed = np.linalg.norm(slip, axis=1), np.maximum(depth, 0.0) + pull
        sticking = sliding <= self.part.static_friction * pressed
        grip = np.where(sticking, 1.0, self.part.dynamic_friction * pressed / np.where(sliding > 0, sliding, 1.0))
        softness = np.where(stiffness > 0, stiffness, np.inf)
        self.pressed[i, j] += depth / softness
        push = (depth[:, None] * normal - grip[:, None] * slip) / softness[:, None]
        moved = now.copy()
        np.add.at(moved, i, self.weight[i][:, None] * push)
        np.add.at(moved, j, -self.weight[j][:, None] * push)
        couple = -np.cross(d / 2, push)  # moves an impulse from a particle's centre to the midpoint between both
        np.add.at(self.couples, i, self.weight[i][:, None] * couple)
        np.add.at(self.couples, j, self.weight[j][:, None] * couple)
        return moved

    def velocity_changes(
        self, now: np.ndarray, old: np.ndarray, velocity: np.ndarray, scale: np.ndarray, rigid: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the changes of velocity [m/s] after which particles in contact at `now` separate by the restitution.

        All contacts act at once. `old`: velocities at the beginning of the substep. `scale` (particles, 3): the largest
        factor of the particle's impulses, and the required and the resulting energy of its body. `rigid` (particles,):
        two rigid particles that contacts pushed apart separate no faster than by the restitution, or than before.
        """
        i, j = self.pairs.T
        d = now[i] - now[j]
        length = np.linalg.norm(d, axis=1)
        normal = d / length[:, None]
        came = -((old[i] - old[j]) * normal).sum(axis=1)
        settling = 2 * self.gravity * self.h
        both = np.zeros(len(i), bool) if rigid is None else rigid[i] & rigid[j]
        comes = -((velocity[i] - velocity[j]) * normal).sum(axis=1)
        came = np.where(both, np.maximum(came, comes), came)
        approaching, e = came > settling, self.part.restitution
        lack = np.where(approaching, e * came, np.maximum(-came, 0.0)) + comes
        pressed = self.pressed[i, j]
        needs = approaching & (lack > 0) & (both | (e > 0))
        acting = needs | (both & (pressed > 0) & (-lack > LEFT * settling))
        acting &= length < BESIDE * self.distance[i, j]
        i, j, normal, lack, pressed = i[acting], j[acting], normal[acting], lack[acting], pressed[acting]
        number = np.bincount(np.concatenate([i, j]), minlength=len(now))
        impulse = self.factor(scale[i], scale[j]) * lack / (self.weight[i] * number[i] + self.weight[j] * number[j])
        impulse = np.maximum(impulse, np.minimum(-pressed / self.h, 0.0))
        changes, self.asked = np.zeros_like(velocity), np.zeros(len(now))
        for k in (i, j):  # for each particle, over its mass: the impulses that its contacts require by themselves
            np.add.at(self.asked, k, self.weight[k] ** 2 * number[k] * impulse**2)
        np.add.at(changes, i, (self.weight[i] * impulse)[:, None] * normal)
        np.add.at(changes, j, -(self.weight[j] * impulse)[:, None] * normal)
        return changes

    def factor(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return the factor (n,) of the impulses of pairs, by the `scale` (n, 3) of either particle in `velocity_changes`."""
        least, worth = np.minimum(one[:, 0], other[:, 0]), one[:, 2] + other[:, 2]
        two = (one[:, 2] > 0) & (other[:, 2] > 0)
        worth = np.where(two, worth, 1.0)
        best, mean = (one[:, 1] + other[:, 1]) / worth, (one[:, 0] * one[:, 2] + other[:, 0] * other[:, 2]) / worth
        most = 2 / (1 + self.part.restitution) * least
        return np.asarray(np.where(two, np.minimum(np.minimum(best, mean), most), least))

    def ended(self, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return the positions [m] at the end of the substep, with limited speed and with slow particles at rest."""
        displacement = now - before
        length = np.linalg.norm(displacement, axis=1)[:, None]
        if self.part.maximum_speed is not None:
            fastest = self.part.maximum_speed * self.h
            now = np.where(length > fastest, before + displacement * (fastest / np.maximum(length, fastest)), now)
        asleep = length < self.part.sleeping_speed * self.h
        return np.where(asleep, before, now)
