"""What the position-based solvers on CUDA share: a state of quads, and steps in graphs of many launches.

A solver sets `particle_count` and `_weight` (particles,), the spare number of its positions; it launches steps from a buffer
on (`_launch`), and says of how many launches a step is (`_launches`). The rest is as in core/simulation.py.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from gpu_backend.core.quads import SIZE
from gpu_backend.core.simulation import CudaSimulation

MAX_NODES = 4096  # launches of one graph
LARGEST_CHUNK = 256  # steps of one graph


class QuadSimulation(CudaSimulation):
    """A position-based simulation on the GPU. See model/core/simulation.py for the contract."""

    particle_count: int
    _weight: np.ndarray

    @abstractmethod
    def _launch(self, parity: int, steps: int) -> None:
        """Launch `steps` steps, the first from the buffers `parity`."""

    @property
    @abstractmethod
    def _launches(self) -> int:
        """Of a step."""

    def _advance_steps(self, step: int, steps: int) -> None:
        self._set_counter(step)
        chunk = LARGEST_CHUNK
        while self._graphs is not None and steps:
            if chunk <= steps and (chunk == 1 or chunk * self._launches <= MAX_NODES):
                parity = self._current
                self._graphs.replay(parity, chunk)
                self._current = parity ^ (chunk * self.scene.method.substeps & 1)
                steps -= chunk
            else:
                chunk //= 2
        if steps:
            self._launch(self._current, steps)
            self._count_on(steps)

    # ------------------------------------------------------------------ the contract

    def _quads(self, array: Any) -> np.ndarray:
        """A device array of quads as (quads, 4) on the host."""
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return host.reshape(-1, SIZE)

    def _to_host(self, array: Any) -> np.ndarray:
        return np.ascontiguousarray(self._quads(array)[:, : self.scene.dimensions])

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for array, values, spare in (
            (self.position[self._current], position, self._weight),
            (self.velocity[self._current], velocity, 0.0),
        ):
            quads = np.zeros((self.particle_count, SIZE), self.real)
            quads[:, : self.scene.dimensions], quads[:, 3] = values, spare
            array.copy_to_device(quads.reshape(-1), stream=self.stream)
        self.synchronize()
