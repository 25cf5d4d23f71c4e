"""Self-contacts of a cloth on CPU threads: the two stages of a position-based solver, and their arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.cpu_backend.contact.self_find import VALUES, Cells, TriangleContacts, make_find
from softlab.cpu_backend.contact.self_project import FORCES, RUBBING, Links, make_project
from softlab.model.contact.self_contact_parameters import (
    MAX_CONTACTS,
    contact_record,
    table_size,
    triangles_around,
)
from softlab.model.core.build import Body
from softlab.model.scene.scene import Scene


class HeldContacts:
    """Contacts of masses with triangles: storage for the MAX_CONTACTS nearest of each, and the sweeps over them.

    `found` (masses,): number of triangles that each may touch. `lost`: number of those beyond the MAX_CONTACTS nearest,
    since it was last set to 0. `weights` (masses,): inverse masses of any unit, 0 if pinned.
    """

    record: np.ndarray
    _around: tuple[np.ndarray, np.ndarray, np.ndarray]  # see `make_project`

    def __init__(
        self,
        part: Any,
        real: Any,
        math: str,
        threads: int,
        weights: np.ndarray,
        values: int = VALUES,
        surfaces: bool = False,
    ):
        self.real, self.sweeps, self._bands = real, part.sweeps, threads
        self.weights = np.ascontiguousarray(weights, real)
        masses = len(weights)
        most = masses * MAX_CONTACTS
        self.triangles, self.corners = np.zeros(most, np.int32), np.zeros((most, 3), np.int32)
        self.values, self.contact_counts = np.zeros((most, values), real), np.zeros(masses, np.int32)
        self._contacts = TriangleContacts(self.triangles, self.corners, self.values)
        self._links = (np.zeros(masses + 1, np.int32), np.zeros(threads, np.int64), np.zeros(3 * most, np.int32))
        rubs = part.static_friction > 0
        forces = RUBBING if rubs and surfaces else FORCES
        self._scratch = (np.zeros((masses, 3), real), np.zeros(masses, real), np.zeros((most, forces), real))
        self._project = make_project(real, math, rubs, surfaces)
        self.lost = 0
        self._empty = True

    def _link(self) -> None:
        """List, for each mass, the contacts that it is a corner of, and begin the sums of a substep."""
        self._empty = not self.contact_counts.any()
        if not self._empty:
            self._project.link_contacts(self._bands, self.contact_counts, self.corners, *self._links, self._scratch[2])

    def _sweep(self, begin: np.ndarray, position: np.ndarray) -> None:
        """Sweep over the contacts of the substep that began at `begin` (masses, 3 ...), on (3, rows, columns) [m]."""
        if self._empty:
            return
        starts, _, links = self._links
        stored = self.contact_counts, self._contacts, Links(starts, links), self._around
        self._project.project_contacts(
            self._bands, self.sweeps, position, begin, stored, self.weights, self.record[0], self._scratch
        )


class Contacts(HeldContacts):
    """Self-contacts of a cloth in a substep. `weights` in the order of the sheet's masses.

    `find` makes them from the state before a substep and the predicted one; `project` sweeps over them.
    """

    def __init__(self, scene: Scene, body: Body, real: Any, math: str, threads: int, weights: np.ndarray):
        part = scene.self_collision
        assert part is not None
        super().__init__(part, real, math, threads, weights)
        self.rows, self.columns = body.rows, body.columns
        self._around = triangles_around(body.rows, body.columns)
        masses, cells = body.rows * body.columns, max(0, (body.rows - 1) * (body.columns - 1))
        self.change(scene)
        bands = np.zeros(threads, np.int64)
        self._begin, end = np.zeros((masses, 3), real), np.zeros((masses, 3), real)
        boxes, keys = np.zeros((cells, 6), real), np.zeros(cells, np.int64)
        buckets, largest = np.zeros(cells, np.int32), np.zeros(max(1, body.rows - 1), real)
        starts, sorted_cells = np.zeros(table_size(max(1, cells)) + 1, np.int32), np.zeros(cells, np.int32)
        self._hashed = Cells(self._begin, end, boxes, keys, buckets, largest, starts, bands, sorted_cells)
        self._find = make_find(real, math)

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        self.record = contact_record(scene, self.real)

    def find(self, before: np.ndarray, predicted: np.ndarray) -> None:
        """Search the contacts of the substep. Both arrays are (3, rows, columns) [m], views of any strides."""
        if min(self.rows, self.columns) < 2:
            return
        self._find.hash_cells(self._bands, before, predicted, self.record[0], self._hashed)
        self._find.find_contacts(
            self._bands, self.rows, self.columns, self.record[0], self._hashed, self._contacts, self.contact_counts
        )
        self.lost += int(np.maximum(self.contact_counts - MAX_CONTACTS, 0).sum())
        self._link()

    def project(self, position: np.ndarray) -> None:
        """Sweep over the contacts of the substep, on (3, rows, columns) [m]."""
        self._sweep(self._begin, position)
