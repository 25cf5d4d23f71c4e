"""The methods that each backend and solver implements; model/core/simulation.py contains the rest of a simulation.

The state stays on the backend's device; nothing is allocated while steps run.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.core.energy import spring_strain
from softlab.model.core.family import written
from softlab.model.scene.scene import Scene


class Backend(ABC):
    """Base of the solvers of a backend. Methods that are not abstract apply only to scenes with the parts that they
    name, or have an implementation that is valid on any backend."""

    scene: Scene
    real: Any  # the numpy type of the precision
    contacts: Any = None  # of surfaces, and the number of those that did not fit

    @abstractmethod
    def _run(self, steps: int) -> None:
        """Advance the state by `steps` (>= 1) steps from `self.step`, using the current parameter record."""

    @abstractmethod
    def _store_snapshot(self) -> None:
        """Copy the state into a snapshot on the device."""

    @abstractmethod
    def _restore(self) -> None:
        """Restore the state from the snapshot of `_store_snapshot`."""

    @abstractmethod
    def _first_diverged(self) -> int:
        """Return the lowest index of a diverged particle, or -1.

        A particle has diverged if a value is not finite, or it is farther than `self._bound` from `self._centre` along
        an axis.
        """

    @abstractmethod
    def _parameters_changed(self) -> None:
        """Send `self._record` and the poke to the device."""

    @abstractmethod
    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (position, velocity) as new host arrays (particles, dimensions) in the simulation's precision."""

    @abstractmethod
    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set the state from (particles, dimensions) arrays in the simulation's precision."""

    @property
    def rank(self) -> int:
        """Rank of this process where several share the scene (model/domains); rank 0 reports for all."""
        return 0

    def slowest(self, seconds: float) -> float:
        """Return the longest of the times [s] that the processes took, the same on all of them."""
        return seconds

    def _read_position(self, into: object) -> Any:
        """Read the position into `into` (None: a new host array). A backend with a device overrides this for device
        targets."""
        return written(self._download()[0], into)

    def _read_strain(self) -> np.ndarray:
        """Return the strain of each spring or its substitute, as a new host array."""
        return spring_strain(self.scene, self._download()[0])

    def _read_normal(self, into: object) -> Any:
        """Read a cloth's normals into `into` (None: a new host array, in the simulation's precision).

        Computed on the host in float64; a backend overrides this to compute them on its device.
        """
        return written(self.scene.grid.normals(self._read_position(None)).astype(self.real), into)

    def _pin_velocity(self, step: int) -> np.ndarray | float:
        """Return the velocity [m/s] of the pinned masses at the start of step `step`: 0, or that of their motions."""
        return 0

    @abstractmethod
    def synchronize(self) -> None:
        """Return when all steps are done."""

    closed = False

    def close(self) -> None:
        """Free the simulation's memory. After that, every other call fails (`require_open`)."""
        self.closed = True

    def require_open(self) -> None:
        """Raise InputError if the simulation was closed."""
        if self.closed:
            raise InputError(
                "this simulation is closed; open another one, or read its state before the `with` block ends"
            )
