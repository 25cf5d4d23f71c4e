"""Simulations of quads whose pinned particles may move, by motions of the scene or to targets: their rows."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.quad_simulation import QuadSimulation
from softlab.model.contact.cloth_parameters import pin_velocity
from softlab.model.tetrahedra.targets import Targeted


class DrivenSimulation(Targeted, QuadSimulation):
    """A simulation with driven particles; model/core/simulation.py defines the contract. `_rows`: content of `bodies`;
    rows of pins begin at `_first_pin`, 0 if none moves."""

    _rows: np.ndarray
    _first_pin: int

    def _allocate_driven(self) -> None:
        """Allocate the state, the constants and the rows."""
        self._rows, self._first_pin = self._driven_rows()
        self._allocate_quads(self._rows)

    def _send_rows(self, rows: np.ndarray) -> None:
        self._rows[...] = rows
        self.bodies.copy_to_device(self._rows, stream=self.stream)
        self.synchronize()

    def _pin_velocity(self, step: int) -> np.ndarray | float:
        if not self._first_pin:
            return 0
        number = step * self.scene.method.substeps
        return pin_velocity(self._rows, self._first_pin, len(self.body.pinned), number, self._record)
