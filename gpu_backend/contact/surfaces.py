"""Contacts between surfaces of tetrahedral bodies on CUDA: two stages for the solver, and their arrays. Only launches,
so that they can be captured in a graph; in `exact` math with the bits of cpu_backend/contact/surfaces.py."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.contact.neighbours import Neighbours, neighbour_bytes
from softlab.gpu_backend.contact.self_contact import HeldContacts, contact_bytes
from softlab.gpu_backend.contact.self_project import QUADS
from softlab.gpu_backend.contact.surfaces_find import make_find
from softlab.gpu_backend.core.quads import SIZE
from softlab.model.contact.particle_parameters import G_SEARCH_RADIUS, G_SELF_DISTANCE
from softlab.model.contact.self_contact_parameters import MAX_CONTACTS
from softlab.model.contact.surface_parameters import TETRAHEDRA_MEETING, Meeting, neighbour_record
from softlab.model.scene.scene import Scene


def surface_contact_bytes(scene: Scene, item: int, meeting: Meeting = TETRAHEDRA_MEETING) -> int:
    """Return the device memory [bytes] for the contacts of a scene's bodies; `item`: bytes per scalar."""
    surface = meeting.surface(scene)
    particles, vertices = len(surface.rest), len(surface.vertices)
    lists = 4 * (4 * len(surface.triangles) + 2 * vertices + len(surface.at_vertex.indices) + 2 * particles)
    neighbour_space = neighbour_bytes(vertices, True, item) + SIZE * item * (vertices + particles)
    assert scene.contact is not None
    levers = QUADS * SIZE * item * MAX_CONTACTS * particles if scene.contact.static_friction > 0 else 0
    return contact_bytes(particles, item) + levers + neighbour_space + lists


class SurfaceContacts(HeldContacts):
    """The contacts of a substep, as in cpu_backend/contact/surfaces.py. `before`, `predicted`, `position`: quads of
    particles, on the device."""

    def __init__(
        self,
        scene: Scene,
        real: Any,
        math: str,
        weights: np.ndarray,
        stream: Any,
        meeting: Meeting = TETRAHEDRA_MEETING,
    ):
        super().__init__(scene.contact, real, math, weights, stream, surfaces=True)
        self._meeting, surface = meeting, meeting.surface(scene)
        vertices, bodies = surface.vertices, len(surface.edge)
        self._vertices, self._body = self._new(vertices), self._new(surface.body)
        rest = np.zeros((len(surface.rest), SIZE), real)
        rest[:, :3] = surface.rest
        self._rest, self._points = self._new(rest.reshape(-1)), self._new(np.zeros(SIZE * len(vertices), real))
        lists = surface.at_vertex.offsets, surface.at_vertex.indices, surface.triangles.reshape(-1), surface.owned
        self._surface = tuple(self._new(np.ascontiguousarray(one)) for one in lists)
        self._around = self._new(surface.at_particle), *self._surface[1:3]
        pairs = self._new(surface.body[vertices]), self._new(np.arange(bodies, dtype=np.int32)), np.int32(bodies)
        has_self_contact = bool((meeting.pairs(scene)[:, :, G_SELF_DISTANCE] > 0).any())
        self._neighbours = Neighbours(
            real, len(vertices), pairs, rest[vertices, :3] if has_self_contact else None, stream
        )
        balls = meeting.ratio is not None
        self._find, self._of_vertices = make_find(real, math, balls), self._launch(len(vertices))
        self.record, self._pairs = self._new(meeting.record(scene, real)), self._new(self._pairs_of(scene))
        self._ratio = self._new(self._ratio_of(scene))

    def _pairs_of(self, scene: Scene) -> np.ndarray:
        """Return the pairs for the search, and the largest contact distance."""
        pairs = self._meeting.pairs(scene)
        return np.append(neighbour_record(pairs, self._real), pairs[:, :, G_SEARCH_RADIUS].max()).astype(self._real)

    def _ratio_of(self, scene: Scene) -> np.ndarray:
        """Return the ratios of Meeting; a single unread number if there are none."""
        return np.ones(1, self._real) if self._meeting.ratio is None else self._meeting.ratio(scene).astype(self._real)

    @property
    def finding(self) -> int:
        """Number of launches of `find`."""
        return self._neighbours.launches + 8

    @property
    def neighbours_lost(self) -> int:
        """Number of neighbouring vertices that did not fit, over all substeps so far."""
        return self._neighbours.lost

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        self.record.copy_to_device(self._meeting.record(scene, self._real), stream=self._stream)
        self._ratio.copy_to_device(self._ratio_of(scene), stream=self._stream)
        self._pairs.copy_to_device(self._pairs_of(scene), stream=self._stream)

    def find(self, before: Any, predicted: Any) -> None:
        kernels = self._find
        kernels.take[self._of_vertices](before, self._vertices, self._points)
        self._neighbours.find(self._points, self._pairs)
        kernels.clear[self._of_masses](self.contact_counts, self._link_counts)
        kernels.find_contacts[self._of_vertices](
            before, predicted, self._rest, self._body, self._vertices, self._neighbours.table,
            self._neighbours.neighbour_counts, *self._surface, self.record, self._ratio, self.triangles, self.corners,
            self._normals, self.corner_weights, self.contact_counts, self._link_counts, self._lost,
        )  # fmt: skip
        self._link()
