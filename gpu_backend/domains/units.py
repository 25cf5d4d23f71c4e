"""A window's state for the transfer of its borders: rows of units of bytes, whatever numbers they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.device import DeviceArray, simulated
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.domains.kernels import unit_of


def _address(array: Any) -> int:
    return int(array.ctypes.data if simulated() else array.__cuda_array_interface__["data"][0])


class StateUnits:
    """The device arrays of both buffers of one `window`, viewed as arrays of `unit` (see unit_of), with `row` units per
    row of `columns`; for a mesh, per particle."""

    def __init__(self, window: CudaSimulation, columns: int = 1):
        axes = window.scene.dimensions
        numbers = columns * (2 if axes == 2 else SIZE)
        self._window = window
        self.unit = unit_of(window.real, axes, columns)
        self.row = numbers * np.dtype(window.real).itemsize // np.dtype(self.unit).itemsize
        both = zip(window.position, window.velocity, strict=True)
        self._both = [(p.view(self.unit), v.view(self.unit)) for p, v in both]

    def spans(self, row: int, rows: int) -> list[list[tuple[int, int]]]:
        """Return, for either buffer, the (address, bytes) of some rows: of their positions, of their velocities."""
        unit = np.dtype(self.unit).itemsize
        first, size = row * self.row * unit, rows * self.row * unit
        return [[(_address(array) + first, size) for array in both] for both in self._both]

    @property
    def now(self) -> tuple[DeviceArray, DeviceArray]:
        """Return (positions, velocities) of the state."""
        return self._both[self._window._current]
