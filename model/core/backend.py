"""What a backend writes of a simulation, one class per backend and solver; model/core/simulation.py is the rest of it.

The state stays on the backend's device; nothing is allocated while steps run.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from model.core.errors import InputError
from model.fluid.measure import pressures
from model.scene.scene import Scene
from model.scene.sheets import scene_normals


class Backend(ABC):
    """The methods that a solver on a backend has of its own. Those that are not abstract are for scenes with what they speak
    of, or have an answer that holds for any backend."""

    scene: Scene
    real: Any  # the numpy type of the precision

    @abstractmethod
    def _run(self, steps: int) -> None:
        """Advance the state by `steps` (>= 1) steps from `self.step`, using the current parameter record."""

    @abstractmethod
    def _keep(self) -> None:
        """Copy the state aside, on the device."""

    @abstractmethod
    def _restore(self) -> None:
        """Take the state put aside by `_keep` back."""

    @abstractmethod
    def _first_diverged(self) -> int:
        """The lowest index of a particle with a non-finite value, or farther than `self._bound` from `self._centre`
        along an axis, or -1."""

    @abstractmethod
    def _parameters_changed(self) -> None:
        """Send `self._record` and the poke to the device."""

    @abstractmethod
    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        """(position, velocity) as new host arrays (particles, dimensions) in the simulation's precision."""

    @abstractmethod
    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Take (particles, dimensions) arrays in the simulation's precision as the state."""

    @property
    def rank(self) -> int:
        """Of this process, where several have a share each (model/domains); 0 speaks for all."""
        return 0

    def slowest(self, seconds: float) -> float:
        """The longest of the times [s] that the processes took, the same for all of them."""
        return seconds

    def _read_position(self, into: Any) -> Any:
        """Position into `into` (None: a new host array). A backend with a device overrides this for device targets."""
        position, _ = self._download()
        if into is None:
            return position
        into[...] = position
        return into

    def _read_normal(self, into: Any) -> Any:
        """A cloth's normals into `into` (None: a new host array, in the simulation's precision). Computed on the host in
        float64; a backend overrides this to compute them where the state is."""
        normal = scene_normals(self.scene, self._read_position(None))
        if into is None:
            return normal.astype(self.real)
        into[...] = normal
        return into

    def _download_rotation(self) -> np.ndarray | None:
        """The clusters' rotations of the state, see State; None where a scene has no bodies."""
        return None

    def _upload_rotation(self, rotation: np.ndarray | None) -> None:  # noqa: B027 - most scenes have none
        """Take rotations, or find those of the state that was uploaded, from no rotation."""

    def _download_plastic(self) -> np.ndarray | None:
        """What clusters have been bent by, see State; None where a scene has no plastic bodies."""
        return None

    def _download_wetness(self) -> np.ndarray | None:
        """How wet a cloth is, see State; None where a scene has none that drinks."""
        return None

    def _upload_plastic(self, plastic: np.ndarray | None) -> None:  # noqa: B027 - most scenes have none
        """Take it; None: no cluster is bent. Comes before `_upload_rotation`."""

    def _read_deformation(self) -> np.ndarray:
        """(clusters, 3, 3): what takes rest offsets to goals, with particles where they are now, as a new host array."""
        raise NotImplementedError

    def _multipliers(self) -> np.ndarray:
        """(particles,) [m^2]: of the density constraints of fluids, of the last substep, as a new host array."""
        raise NotImplementedError

    def _read_pressure(self) -> np.ndarray:
        """(particles,) [Pa]: what the pairs of each carry, as a new host array."""
        return pressures(self.scene, self._download()[0], self._multipliers())

    def _read_clusters(self) -> tuple[np.ndarray, np.ndarray]:
        """(rotation (clusters, 4), centre of mass (clusters, 3) [m]) of bodies with particles where they are now, as new
        host arrays; the state stays as it is."""
        raise NotImplementedError

    def _weights_changed(self) -> None:
        """Send `self.body.inverse_mass` to where the state is; the state itself is uploaded right after it."""
        raise NotImplementedError

    def _pin_velocity(self, step: int) -> Any:
        """Of the pinned masses [m/s] when step `step` begins: 0, or what their motions say."""
        return 0

    @abstractmethod
    def synchronize(self) -> None:
        """Return when every step asked for has been done."""

    closed = False

    def close(self) -> None:
        """Free what the simulation holds. Nothing else may be called after it, which `require_open` sees to."""
        self.closed = True

    def require_open(self) -> None:
        """Raise InputError if the simulation was closed."""
        if self.closed:
            raise InputError(
                "this simulation is closed; open another one, or read its state before the `with` block ends"
            )
