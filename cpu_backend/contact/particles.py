"""Contacts between particles of bodies on CPU threads: the stages "find neighbours", "project contacts" and "bounce", and
what they keep. See model/scene/particle_contact.py; particles are in the places of cpu_backend/shape_matching/layout.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpu_backend.contact.particles_bounce import make_bounce_stage
from cpu_backend.contact.particles_find import AXES, BOX, PLACES, ROOM, TABLE, make_find_stage
from cpu_backend.contact.particles_project import make_project_stage
from cpu_backend.core.layout import aligned_zeros
from model.contact.particle_parameters import (
    G_REACH,
    MAX_NEIGHBOURS,
    kinds_of_particles,
    pair_rows,
    particle_contact_record,
)
from model.formulas.cluster import LANES
from model.scene.scene import Scene

NO_CONTACTS: tuple[Any, ...] = ((),) * 7  # ParticleContacts.arrays of a scene without
CELLS = 12  # of the table for a particle: with less it goes round for what falls in a column


class ParticleContacts:
    """The contacts of a substep. `slots` (particles,): where each particle lies in planes of `count`; `bands`: threads.

    `find` makes the lists of neighbours from predicted positions, `project` sweeps over contacts among them; both take
    positions as three planes, flat, and `weights` (count,), inverse masses of any unit: what weighs 0 meets nobody. `old`:
    room for the velocities with which the substep began, where particles bounce; `bounce` takes those that it ended with.
    `arrays` is what kernels take; `lost`: neighbours beyond the MAX_NEIGHBOURS of a particle, since it was made.
    """

    def __init__(
        self, scene: Scene, real: Any, math: str, parts: frozenset[str], slots: np.ndarray, count: int, bands: int
    ):
        assert scene.contact is not None
        self.real, self.bands, self.sweeps, self.kinds = real, bands, scene.contact.sweeps, len(scene.bodies)
        body, kind, rest = np.zeros(count, np.int32), np.zeros(count, np.int32), np.zeros(AXES * count, real)
        body[slots], kind[slots] = scene.body_set.body, kinds_of_particles(scene)
        rest.reshape(AXES, -1)[:, slots] = scene.body_set.position.T
        cells, most, ahead = CELLS * max(count, LANES), count * MAX_NEIGHBOURS, count + LANES
        numbers = (np.zeros(n, np.int64) for n in (BOX * bands, TABLE, bands, bands, bands, bands))
        boxes, table, totals, begins, active, self._lost = numbers
        buckets, starts = np.zeros(count, np.int32), np.zeros(cells + 1, np.int32)
        tables = np.zeros(AXES * count, np.int32), boxes, table, buckets, starts, totals
        order, bodies, rooms = (np.zeros(n, np.int32) for n in (ahead, ahead, ROOM * bands))
        in_order = order, aligned_zeros(PLACES * ahead, real), bodies, rooms
        who, entries, acting = (np.zeros(n, np.uint32) for n in (count, most, most))  # unsigned: no index from the end
        many, pairs = np.zeros(count, np.int32), np.zeros(most, np.int32)
        self._found = who, many, entries, pairs, begins, active, self._lost
        self._contacts = acting, np.zeros(count, real), np.zeros(AXES * count, real)
        self.old = aligned_zeros(AXES * count if "contact-restitution" in parts else 0, real)
        self._search = (body, kind, rest), tables, in_order, self._found
        self._find = make_find_stage(real, math)
        self._project = make_project_stage(real, math, "contact-friction" in parts, "contact-adhesion" in parts)
        self._bounce = make_bounce_stage(real, math)
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Take over what may change while running."""
        self.record = particle_contact_record(scene, self.real)
        self.reach = self.real(pair_rows(scene)[:, :, G_REACH].max())

    @property
    def lost(self) -> int:
        return int(self._lost.sum())

    @property
    def arrays(self) -> tuple[Any, ...]:
        """What a kernel takes, as NO_CONTACTS has it where there are none: (record, reach, kinds, sweeps), four tuples that
        the search takes, the last of them what it found, one that the projection does, (old,)."""
        numbers = self.record, self.reach, self.kinds, self.sweeps
        return numbers, *self._search, self._contacts, (self.old,)

    def find(self, position: np.ndarray, weights: np.ndarray) -> None:
        self._find(self.bands, position, weights, self.record, self.reach, self.kinds, *self._search)

    def project(self, before: np.ndarray, position: np.ndarray, weights: np.ndarray) -> None:
        self._project(
            self.bands, self.sweeps, before, position, weights, self.record, self._found, self._contacts
        )  # fmt: skip

    def bounce(self, position: np.ndarray, velocity: np.ndarray, weights: np.ndarray) -> None:
        self._bounce(self.bands, position, self.old, velocity, weights, self.record, self._found, self._contacts)

    def neighbours(self) -> dict[int, list[int]]:
        """Of each particle's place that has any, the places of its neighbours in their order."""
        who, many, entries, _, begins, active, _ = self._found
        found: dict[int, list[int]] = {}
        for first, number in zip(begins, active, strict=True):
            entry = int(first) * MAX_NEIGHBOURS
            for n in range(int(first), int(first + number)):
                found[int(who[n])] = entries[entry : entry + many[n]].tolist()
                entry += int(many[n])
        return found
