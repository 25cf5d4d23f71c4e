"""Contacts between surfaces of tetrahedral bodies on CPU threads: the stages "find contacts" and "project contacts"."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.contact.neighbours import Neighbours
from softlab.cpu_backend.contact.self_contact import HeldContacts
from softlab.cpu_backend.contact.self_find import VALUES_OF_SURFACES
from softlab.cpu_backend.contact.surfaces_find import make_find
from softlab.model.contact.particle_parameters import G_SEARCH_RADIUS
from softlab.model.contact.surface_parameters import TETRAHEDRA_MEETING, Meeting, neighbour_record
from softlab.model.scene.scene import Scene

AXES = 3


class SurfaceContacts(HeldContacts):
    """The contacts of a substep: vertices against the triangles of other bodies, and against distant parts of their own
    body if it has self-contact.

    Particles are rows of numbers, positions first. `weights` (particles,): their inverse masses. `meeting`: the family
    of the surfaces. `find` makes the contacts from the state before a substep and the predicted one; `project` sweeps
    over them.
    """

    def __init__(
        self,
        scene: Scene,
        real: Any,
        math: str,
        threads: int,
        weights: np.ndarray,
        meeting: Meeting = TETRAHEDRA_MEETING,
    ):
        super().__init__(scene.contact, real, math, threads, weights, VALUES_OF_SURFACES, surfaces=True)
        self._meeting, surface = meeting, meeting.surface(scene)
        self._vertices, self._body, count = surface.vertices, surface.body, len(surface.vertices)
        self._rest = np.ascontiguousarray(surface.rest, real)
        self._at_vertex = surface.at_vertex.offsets, surface.at_vertex.indices
        self._surface = np.ascontiguousarray(surface.triangles), surface.owned
        self._around = surface.at_particle, surface.at_vertex.indices, self._surface[0]
        vertex_body = np.ascontiguousarray(surface.body[surface.vertices])
        rest = np.ascontiguousarray(self._rest[surface.vertices].T).reshape(-1)
        self._neighbours = Neighbours(real, math, vertex_body, vertex_body, rest, len(surface.edge), threads)
        self._places, self._ones = np.zeros(AXES * count, real), np.ones(count, real)
        self._missed = np.zeros(threads, np.int64)
        self._seen = np.zeros((threads, len(surface.triangles)), np.int32)
        self._find, self._ratio = make_find(real, math, meeting.ratio is not None), np.zeros(0, real)
        self.change(scene)

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        pairs = self._meeting.pairs(scene)
        self.record, self._pairs = self._meeting.record(scene, self.real), neighbour_record(pairs, self.real)
        self._search_radius = self.real(pairs[:, :, G_SEARCH_RADIUS].max())
        if self._meeting.ratio is not None:
            self._ratio = self._meeting.ratio(scene).astype(self.real)

    def find(self, before: np.ndarray, predicted: np.ndarray) -> None:
        """Search the contacts of the substep. Both arrays are (particles, 3 or more) [m]."""
        self._places.reshape(AXES, -1)[...] = before[self._vertices, :AXES].T
        self._neighbours.find(self._places, self._ones, self._pairs, self._search_radius)
        self.contact_counts[...] = 0
        self._find(
            self._bands, (before, predicted), (self._rest, self._body), self._vertices, self._neighbours.pair_lists,
            (self._at_vertex, self._surface), self.record[0], self._ratio,
            (self._contacts, self.contact_counts, self._missed, self._seen),
        )  # fmt: skip
        self.lost += int(self._missed.sum())
        self._link()

    def project(self, before: np.ndarray, position: np.ndarray) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        self._sweep(before, position[:, :AXES].T[:, None])

    @property
    def neighbours_lost(self) -> int:
        """Number of neighbouring vertices that did not fit, since the object was made."""
        return self._neighbours.lost
