"""Common parts of solvers of quads: four numbers per particle, in a flat array; `_weight` is the fourth of a
position."""

from __future__ import annotations

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray
from softlab.gpu_backend.core.integers import integers_of, knows_time
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.simulation import CudaSimulation


class QuadSimulation(CudaSimulation):
    """A simulation on the GPU whose state is quads; model/core/simulation.py defines the contract.

    `_weight` (particles,): the fourth number of positions; `_fourth`: of velocities. `bodies`: the rows of colliders,
    and of other moving objects.
    """

    _weight: np.ndarray
    _fourth: np.ndarray | float = 0.0
    bodies: DeviceArray

    def new_array(self) -> DeviceArray:
        """Return a device array of quads, zeros."""
        return self.zeros(SIZE * self.particle_count, self.real)

    def _allocate_quads(self, rows: np.ndarray) -> None:
        """Allocate the state, the constants, and `bodies` from `rows`."""
        self._integers = integers_of(self.scene)
        self._allocate_state()
        self.bodies = self.on_device(rows)
        self._counts = knows_time(self.plan.parts)

    # ------------------------------------------------------------------ the contract

    def _quads(self, array: DeviceArray) -> np.ndarray:
        """Return a device array of quads as (quads, 4) on the host."""
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return host.reshape(-1, SIZE)

    def _to_host(self, array: DeviceArray) -> np.ndarray:
        return np.ascontiguousarray(self._quads(array)[:, : self.scene.dimensions])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for array, values, fourth in (
            (self.position[self._current], position, self._weight),
            (self.velocity[self._current], velocity, self._fourth),
        ):
            quads = np.zeros((self.particle_count, SIZE), self.real)
            quads[:, : self.scene.dimensions], quads[:, 3] = values, fourth
            array.copy_to_device(quads.reshape(-1), stream=self.stream)
        self.synchronize()
