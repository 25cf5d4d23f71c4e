"""Bodies of clusters on any backend: spare copies, and rotations with centres at the same instant."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softlab.model.core.simulation import STILL, Simulation
from softlab.model.shape_matching import spare


class BodiesSimulation(Simulation):
    """A simulation of bodies of clusters; see model/core/simulation.py for its methods."""

    @abstractmethod
    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (rotation (clusters, 4), centre of mass (clusters, 3) [m]) at the current positions, as new host arrays.

        The state does not change.
        """

    @abstractmethod
    def _weights_changed(self) -> None:
        """Send `self.body.inverse_mass` to the device; the state itself is uploaded afterwards."""

    def _take_masses(self, position: np.ndarray, inverse_mass: np.ndarray, time: float) -> None:
        """Set which copies are inactive. Raises InputError where anything else differs."""
        if not self._are_masses_at(inverse_mass, time):
            weights = spare.weights(self.scene, self.plan.parts, inverse_mass)
            self.body = replace(self.body, inverse_mass=weights, pinned=np.flatnonzero(weights == 0))
            self._weights_changed()

    def add_body(self, name: str, origin: Sequence[float] | None = None, velocity: Sequence[float] = STILL) -> int:
        number, state = spare.added(self.scene, self.state(), name, origin, velocity)
        self.load(state)
        return number

    def remove_body(self, number: int) -> None:
        self.load(spare.removed(self.scene, self.state(), self.plan.parts, number))

    def read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        if "rotation" not in self.fields:
            return super().read_clusters()
        self.require_open()
        return self._read_clusters()
