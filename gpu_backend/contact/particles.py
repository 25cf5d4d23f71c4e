"""Contacts between particles of bodies on CUDA: three stages that the solver launches, and what they keep. Launches alone, so
that they can be captured in a graph; in `exact` math to the bits of cpu_backend/contact/particles.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.contact.particles_bounce import make_bounce
from gpu_backend.contact.particles_find import MIN_TABLE, make_find
from gpu_backend.contact.particles_project import make_project
from gpu_backend.core.quads import SIZE
from gpu_backend.core.scan import Scan
from model.contact.particle_parameters import (
    G_OWN,
    G_REACH,
    MAX_NEIGHBOURS,
    contact_parts,
    kinds_of_particles,
    pair_rows,
    particle_contact_record,
)
from model.contact.self_contact_parameters import table_size
from model.scene.scene import Scene

THREADS = 128


def _table(particles: int) -> int:
    return max(MIN_TABLE, table_size(particles))


def _meets_itself(scene: Scene) -> bool:
    return bool((pair_rows(scene)[:, :, G_OWN] > 0).any())


def particle_contact_bytes(scene: Scene, item: int) -> int:
    """Device memory for the contacts of a scene's particles, `item` bytes a scalar."""
    particles = scene.body_set.particle_count
    quads = SIZE * item * (2 + _meets_itself(scene))
    return particles * (quads + 4 * (MAX_NEIGHBOURS + 6)) + 8 * (_table(particles) + 1)


class ParticleContacts:
    """The neighbours of each particle: `found` (particles,) int32, how many; `neighbours` (MAX_NEIGHBOURS * particles,), the
    s-th of particle i in place s * particles + i; `bounces`: whether they do. `before`, `position`: quads of particles and
    their weights, on the device."""

    def __init__(self, scene: Scene, real: Any, math: str, stream: Any):
        part, body_set = scene.contact, scene.body_set
        assert part is not None
        self._real, self._stream, self._sweeps = real, stream, part.sweeps
        particles, kinds = body_set.particle_count, len(scene.bodies)
        parts, own, many = contact_parts(scene), _meets_itself(scene), kinds > 1
        self.record = self._new(self._record_of(scene))
        kind = np.zeros(len(body_set.copies), np.int32)
        kind[body_set.body] = kinds_of_particles(scene)
        self._pairs = self._new(body_set.body.astype(np.int32)), self._new(kind), np.int32(kinds)
        rest = np.zeros((particles if own else 1, SIZE), real)
        rest[:, :3] = body_set.clusters.position if own else 0
        self._rest = self._new(rest.reshape(-1))
        table = _table(particles) + 1  # the last number of its starts is that of all
        self._counts, self._starts = self._integers(table), self._integers(table)
        self._buckets, self._filled, self._sorted_particles, self._sorted_bodies, self.found = (
            self._integers(particles) for _ in range(5)
        )
        self._sorted, self._touching = (self._new(np.zeros(SIZE * particles, real)) for _ in range(2))
        self.neighbours = cuda.device_array(MAX_NEIGHBOURS * particles, np.int32, stream=stream)
        self._lost = self._new(np.zeros(1, np.int64))
        self._scan, self._flat = Scan(table, stream), ((particles + THREADS - 1) // THREADS, THREADS, stream)
        self._find = make_find(real, own, many)
        self.variant = own, many
        self.bounces, self._bounce = "contact-restitution" in parts, make_bounce(real, math, own, many)
        self._project = make_project(real, math, "contact-friction" in parts, "contact-adhesion" in parts, own, many)

    def _new(self, array: np.ndarray) -> Any:
        return cuda.to_device(array, stream=self._stream)

    def _integers(self, count: int) -> Any:
        return self._new(np.zeros(count, np.int32))

    def _record_of(self, scene: Scene) -> np.ndarray:
        """The record and the longest reach."""
        record = particle_contact_record(scene, self._real)
        return np.append(record, pair_rows(scene)[:, :, G_REACH].max()).astype(self._real)

    @property
    def finding(self) -> int:
        """Launches of `find`."""
        return 7

    @property
    def projecting(self) -> int:
        """Launches of `project`."""
        return 2 * self._sweeps

    @property
    def restitution_launches(self) -> int:
        """Launches of `bounce`."""
        return 2

    @property
    def lost(self) -> int:
        """How many neighbours were beyond the MAX_NEIGHBOURS of a particle, over all substeps so far."""
        host = self._lost.copy_to_host(stream=self._stream)
        cuda.synchronize()
        return int(host[0])

    def forget(self) -> None:
        """Nothing was lost so far."""
        self._lost.copy_to_device(np.zeros(1, np.int64), stream=self._stream)

    def change(self, scene: Scene) -> None:
        """Take over what may change while running."""
        self.record.copy_to_device(self._record_of(scene), stream=self._stream)

    def find(self, position: Any) -> None:
        """The neighbours of all particles where they are predicted to be."""
        kernels, flat, ordered = self._find, self._flat, (self._sorted, self._sorted_particles, self._sorted_bodies)
        kernels.hash_particles[flat](position, self.record, self._buckets, self._counts)
        self._scan.run(self._counts, self._starts, self._starts)
        kernels.fill_buckets[flat](self._buckets, self._starts, self._counts, self._filled)
        kernels.arrange[flat](position, self._buckets, self._starts, self._filled, self._pairs[0], *ordered)
        kernels.find_neighbours[flat](
            position, self.record, self._buckets, self._starts, *ordered, *self._pairs, self._rest, self.neighbours,
            self.found, self._lost,
        )  # fmt: skip

    def project(self, before: Any, position: Any) -> None:
        """All sweeps over the contacts of the substep that began at `before`."""
        arguments = self.found, self.neighbours, self.record, *self._pairs, self._touching
        for _ in range(self._sweeps):
            self._project.count[self._flat](position, *arguments)
            self._project.project[self._flat](before, position, *arguments)

    def count_impacts(self, position: Any, old: Any, velocity: Any) -> tuple[Any, ...]:
        """What `bounce` begins with, for those that go on in another way: what their kernels take of contacts."""
        arguments = position, old, velocity, self.found, self.neighbours, self.record, *self._pairs, self._touching
        self._bounce.count[self._flat](*arguments)
        return arguments

    def bounce(self, position: Any, old: Any, velocity: Any) -> None:
        """Of those that touch at `position`: with `old` velocities the substep began, with `velocity` it ends."""
        arguments = self.count_impacts(position, old, velocity)
        self._bounce.bounce[self._flat](*arguments)
