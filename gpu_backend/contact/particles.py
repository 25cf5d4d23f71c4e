"""Contacts between particles of bodies on CUDA: three stages for the solver, and their arrays. Only launches, so that
they can be captured in a graph; in `exact` math with the bits of cpu_backend/contact/particles.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.neighbours import Neighbours, neighbour_bytes
from softlab.gpu_backend.contact.particles_bounce import make_bounce
from softlab.gpu_backend.contact.particles_project import make_project
from softlab.gpu_backend.core.device import Arguments, DeviceArray, Stream
from softlab.gpu_backend.core.quads import SIZE
from softlab.model.base.types import Real
from softlab.model.contact.particle_parameters import (
    G_SEARCH_RADIUS,
    G_SELF_DISTANCE,
    MAX_NEIGHBOURS,
    contact_parts,
    kinds_of_particles,
    pair_rows,
    particle_contact_record,
)
from softlab.model.scene.scene import Scene


def _has_self_contact(scene: Scene) -> bool:
    return bool((pair_rows(scene)[:, :, G_SELF_DISTANCE] > 0).any())


def particle_contact_bytes(scene: Scene, item: int) -> int:
    """Return the device memory [bytes] for the contacts of a scene's particles; `item`: bytes per scalar."""
    particles = scene.body_set.particle_count
    pressed = MAX_NEIGHBOURS * item * particles  # of rigid bodies
    return neighbour_bytes(particles, _has_self_contact(scene), item) + SIZE * item * particles + pressed


class ParticleContacts:
    """Contacts among the `neighbours` of particles; `bounces`: true with restitution.

    `before`, `position`: quads of particles and their weights, on the device; `parts`: the scene's, None for contacts
    only.
    """

    def __init__(self, scene: Scene, real: Real, math: str, stream: Stream, parts: frozenset[str] | None = None):
        part, body_set = scene.contact, scene.body_set
        assert part is not None
        self._real, self._stream, self._sweeps = real, stream, part.sweeps
        particles, kinds = body_set.particle_count, len(scene.bodies)
        self_contact, many, parts = (
            _has_self_contact(scene),
            kinds > 1,
            contact_parts(scene) if parts is None else parts,
        )
        self.record = self._new(self._record_of(scene))
        kind = np.zeros(len(body_set.copies), np.int32)
        kind[body_set.body] = kinds_of_particles(scene)
        self._pairs = self._new(body_set.body.astype(np.int32)), self._new(kind), np.int32(kinds)
        rest = body_set.clusters.position if self_contact else None
        self.neighbours = Neighbours(real, particles, self._pairs, rest, stream)
        self._touching = self._new(np.zeros(SIZE * particles, real))
        self._flat = self.neighbours.flat
        self.variant = self_contact, many
        self._keeps, has_couples = "rigid-motion" in parts, "couples" in parts
        self.bounces = "contact-restitution" in parts
        self._bounce = make_bounce(real, math, self_contact, many, self._keeps)
        self._pressed = self._new(np.zeros(MAX_NEIGHBOURS * particles if self._keeps else 0, real))
        variant = "contact-friction" in parts, "contact-adhesion" in parts, self_contact, many, self._keeps, has_couples
        self._project = make_project(real, math, *variant)

    def _new(self, array: np.ndarray) -> DeviceArray:
        return cuda.to_device(array, stream=self._stream)

    def _record_of(self, scene: Scene) -> np.ndarray:
        """Return the record and the largest contact distance."""
        record = particle_contact_record(scene, self._real)
        return np.append(record, pair_rows(scene)[:, :, G_SEARCH_RADIUS].max()).astype(self._real)

    @property
    def finding(self) -> int:
        """Number of launches of `find`."""
        return self.neighbours.launches + self._keeps

    @property
    def projecting(self) -> int:
        """Number of launches of `project`."""
        return 2 * self._sweeps

    @property
    def restitution_launches(self) -> int:
        """Number of launches of `bounce`."""
        return 2

    @property
    def lost(self) -> int:
        """Number of neighbours beyond the MAX_NEIGHBOURS of a particle, over all substeps so far."""
        return self.neighbours.lost

    def forget(self) -> None:
        """Set the counter to 0."""
        self.neighbours.forget()

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        self.record.copy_to_device(self._record_of(scene), stream=self._stream)

    def find(self, position: DeviceArray) -> None:
        """Search the neighbours of all particles at the predicted positions."""
        self.neighbours.find(position, self.record)
        if self._keeps:
            self._project.clear[self._flat](self.neighbours.neighbour_counts, self._pressed)

    def project(
        self, before: DeviceArray, position: DeviceArray, travel: DeviceArray | None = None, couples: Any = None
    ) -> None:
        """Sweep over the contacts of the substep that began at `before`; `travel`: with rigid bodies; `couples`: with
        friction that turns clusters."""
        arguments = self.neighbours.neighbour_counts, self.neighbours.table, self.record, *self._pairs, self._touching
        unread = self._touching  # an array that is not read as this one
        written = unread if travel is None else travel, self._pressed, unread if couples is None else couples
        for _ in range(self._sweeps):
            self._project.count[self._flat](position, *arguments)
            self._project.project[self._flat](before, position, *arguments, *written)

    def count_impacts(
        self, position: DeviceArray, old: DeviceArray, velocity: DeviceArray, travel: DeviceArray
    ) -> Arguments:
        """Count the impacts of rigid bodies, and return the arguments of their kernels about contacts."""
        arguments = *self._impacts(position, old, velocity), travel, self._pressed
        self._bounce.count[self._flat](*arguments)
        return arguments

    def _impacts(self, *states: Any) -> Arguments:
        counts, table = self.neighbours.neighbour_counts, self.neighbours.table
        return *states, counts, table, self.record, *self._pairs, self._touching

    def bounce(self, position: DeviceArray, old: DeviceArray, velocity: DeviceArray) -> None:
        """Bounce particles in contact at `position`; `old`, `velocity`: velocities at the substep's start and end."""
        arguments = self._impacts(position, old, velocity)
        self._bounce.count[self._flat](*arguments, self._touching, self._pressed)
        self._bounce.bounce[self._flat](*arguments)
