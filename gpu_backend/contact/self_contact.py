"""Self-contacts of a cloth on CUDA: two stages for a position-based solver, and their arrays. Only launches, so that
they can be captured in a graph; in `exact` math with the bits of cpu_backend/contact/self_contact.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.self_find import make_find
from softlab.gpu_backend.contact.self_project import QUADS, make_project
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.scan import Scan
from softlab.model.contact.self_contact_parameters import (
    MAX_CONTACTS,
    contact_record,
    table_size,
    triangles_around,
)
from softlab.model.core.build import Body
from softlab.model.scene.scene import Scene

THREADS = 128


def contact_bytes(masses: int, item: int) -> int:
    """Return the device memory [bytes] for the contacts of so many masses; `item`: bytes per scalar."""
    contacts = MAX_CONTACTS * (3 * SIZE * item + 4 + 12 + 12)
    return masses * (contacts + 2 * SIZE * item + 8 + 4 * (2 + 3 * 4) + 4 * 4 + 4 * (1 + 6 + 6) + 2 * item)


class HeldContacts:
    """Stored contacts, as in cpu_backend/contact/self_contact.py. `position`, `before`: quads of masses, on the
    device."""

    record: Any
    _around: tuple[Any, Any, Any]  # see `make_project`

    def __init__(
        self,
        part: Any,
        real: Any,
        math: str,
        weights: np.ndarray,
        stream: Any,
        surfaces: bool = False,
    ):
        self._real, self._stream, self._sweeps = real, stream, part.sweeps
        masses = len(weights)
        most = masses * MAX_CONTACTS
        self._weights = self._new(np.ascontiguousarray(weights, real))
        self.triangles, self.corners = self._integers(most), self._integers(3 * most)
        self._normals, self.corner_weights, self._forces = (self._new(np.zeros(SIZE * most, real)) for _ in range(3))
        self.contact_counts, self._loads = self._integers(masses), self._new(np.zeros(masses, real))
        self._link_counts, self._link_starts, self._link_cursors = (self._integers(masses) for _ in range(3))
        self._links, self._lost = self._integers(3 * most), self._new(np.zeros(1, np.int64))
        self._link_scan = Scan(masses, stream)
        rubs = part.static_friction > 0
        self._levers = rubs and surfaces
        self._rubbing = self._new(np.zeros(QUADS * SIZE * most if self._levers else 0, real))
        self._project, self._of_masses = make_project(real, math, rubs, surfaces), self._launch(masses)

    def _new(self, array: np.ndarray) -> Any:
        return cuda.to_device(array, stream=self._stream)

    def _integers(self, count: int) -> Any:
        return self._new(np.zeros(count, np.int32))

    def _launch(self, threads: int) -> tuple:
        return (threads + THREADS - 1) // THREADS, THREADS, self._stream

    @property
    def projecting(self) -> int:
        """Number of launches of `project`."""
        return (4 + 2 * self._levers) * self._sweeps

    @property
    def lost(self) -> int:
        """Number of contacts beyond the MAX_CONTACTS nearest of a mass, since the object was made."""
        return int(self._lost.copy_to_host(stream=self._stream)[0])

    def _link(self) -> None:
        """List, for each mass, the contacts that it is a corner of, and begin the sums of a substep."""
        self._link_scan.run(self._link_counts, self._link_starts, self._link_cursors)
        self._project.fill_links[self._of_masses](
            self.contact_counts, self.corners, self._link_cursors, self._links, self._rubbing
        )
        self._project.sort_links[self._of_masses](self._link_starts, self._link_counts, self._links)

    def project(self, before: Any, position: Any) -> None:
        """Sweep over the contacts of the substep that began at `before`."""
        kernels, flat = self._project, self._of_masses
        links = self._link_starts, self._link_counts, self._links
        contacts = position, before, self.contact_counts, self.corners, self._normals, self.corner_weights
        written = self._forces, self._rubbing
        to_move = position, self.contact_counts, self.corner_weights, *links, self._weights, self._loads, *written
        for _ in range(self._sweeps):
            kernels.deepen[flat](*contacts, *self._around, self._forces)
            kernels.load_up[flat](self.contact_counts, self.corner_weights, *links, self._forces, self._loads)
            kernels.push[flat](*contacts, self._weights, self._loads, self.record, *written)
            kernels.gather[flat](*to_move)
        for _ in range(self._sweeps if self._levers else 0):
            kernels.rub[flat](*contacts, self._weights, self._loads, self.record, *written)
            kernels.gather_rubbed[flat](*to_move)


class Contacts(HeldContacts):
    """Self-contacts of a cloth in a substep, as in cpu_backend/contact/self_contact.py. `before`, `predicted`,
    `position`: quads of masses, on the device."""

    def __init__(self, scene: Scene, body: Body, real: Any, math: str, weights: np.ndarray, stream: Any):
        part = scene.self_collision
        assert part is not None
        super().__init__(part, real, math, weights, stream)
        self._shape = (np.int32(body.rows), np.int32(body.columns))
        masses, cells = body.rows * body.columns, (body.rows - 1) * (body.columns - 1)
        self._touches = cells > 0
        self._around = tuple(self._new(one.reshape(-1)) for one in triangles_around(body.rows, body.columns))
        cells = max(1, cells)
        table = table_size(cells)
        self.record = self._new(contact_record(scene, real))
        self._boxes, self._largest = self._new(np.zeros(2 * SIZE * cells, real)), self._new(np.zeros(1, real))
        self._keys, self._buckets = self._new(np.zeros(cells, np.int64)), self._integers(cells)
        self._counts, self._starts, self._cursors = (self._integers(table) for _ in range(3))
        self._sorted = self._integers(cells)
        self._scan, self._find = Scan(table, stream), make_find(real, math)
        self._of_cells, self._of_table = self._launch(cells), self._launch(max(table, masses))

    @property
    def finding(self) -> int:
        """Number of launches of `find`."""
        return 12 if self._touches else 0

    @property
    def projecting(self) -> int:
        return super().projecting if self._touches else 0

    def change(self, scene: Scene) -> None:
        """Apply the parameters that may change during a run."""
        self.record.copy_to_device(contact_record(scene, self._real), stream=self._stream)

    def find(self, before: Any, predicted: Any) -> None:
        if not self._touches:
            return
        kernels = self._find
        kernels.clear[self._of_table](self._counts, self._link_counts, self._largest)
        kernels.hash_cells[self._of_cells](
            before, predicted, self.record, self._boxes, self._keys, self._buckets, self._counts, self._largest,
            *self._shape,
        )  # fmt: skip
        self._scan.run(self._counts, self._starts, self._cursors)
        kernels.fill_buckets[self._of_cells](self._buckets, self._cursors, self._sorted)
        kernels.find_contacts[self._of_masses](
            before, predicted, self.record, self._boxes, self._keys, self._starts, self._counts, self._sorted,
            self._largest, self.triangles, self.corners, self._normals, self.corner_weights, self.contact_counts,
            self._link_counts, self._lost, *self._shape,
        )  # fmt: skip
        self._link()

    def project(self, before: Any, position: Any) -> None:
        if self._touches:
            super().project(before, position)
