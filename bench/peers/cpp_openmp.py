"""The grid in C++ with OpenMP (grid.cpp), compiled for this processor when it is first needed.

Two peers: `cpp_openmp` does one step per pass over the grid, with the algorithm of the lab's first fused kernel;
`cpp_openmp_blocked` does several time levels per pass, the fairer comparison for grids beyond the caches.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np

from softlab.bench.peers.base import GridConstants, Opened, Peer
from softlab.bench.peers.compiler import find_compiler, load_library
from softlab.model.scene.scene import Scene

SOURCE = Path(__file__).with_name("grid.cpp")
MAX_LEVELS = 8  # more gained nothing
ROWS_A_LEVEL = 4  # a band with fewer rows would compute too many of them twice
TILE_BYTES = 4096  # of a row of one array: the rings of eight levels then stay in a second-level cache of 1 MiB


class CppOpenmp(Peer):
    """One step per pass."""

    name = "cpp_openmp"
    label = "C++ OpenMP"
    backend = "cpu"
    blocked = False

    def available(self) -> tuple[bool, str]:
        compiler_or_reason = find_compiler()
        return (False, compiler_or_reason) if isinstance(compiler_or_reason, str) else (True, compiler_or_reason[1])

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        return _Grid(GridConstants(scene, precision), threads, self.blocked)


class CppOpenmpBlocked(CppOpenmp):
    """Several time levels per pass."""

    name = "cpp_openmp_blocked"
    label = "C++ OpenMP, blocked"
    blocked = True


class _Grid(Opened):
    def __init__(self, constants: GridConstants, threads: int, blocked: bool):
        self.constants, self.threads = constants, threads
        rows, columns = constants.rows, constants.columns
        item = np.dtype(constants.real).itemsize
        self._levels, self._tile = 0, 0
        if blocked:
            self._levels = max(1, min(MAX_LEVELS, rows // threads // ROWS_A_LEVEL))
            self._tile = TILE_BYTES // item
        self.steps_together = max(1, self._levels)
        self.kernel = f"{self._levels} levels a pass" if blocked else "one step a pass"
        library = load_library(SOURCE)
        self._advance = library.advance_float32 if item == 4 else library.advance_float64
        index, pointer = ctypes.c_int64, ctypes.c_void_p
        self._advance.argtypes = [
            index, index, index, ctypes.c_int, pointer, pointer, pointer, pointer, ctypes.c_int, ctypes.c_int, index,
        ]  # fmt: skip
        self._advance.restype = ctypes.c_int
        self._states = np.zeros((2, 4, rows, columns), constants.real)
        self._current = 0
        self._numbers = np.array(constants.in_order, np.float64)
        pin_row, pin_column = np.divmod(constants.pinned, columns)
        self._pin_start = np.searchsorted(pin_row, np.arange(rows + 1)).astype(np.int64)
        self._pin_column = pin_column.astype(np.int64)
        self.load(constants.position, constants.velocity)

    def advance(self, steps: int) -> None:
        constants = self.constants
        self._current = self._advance(
            constants.rows, constants.columns, steps, self._current, self._states.ctypes.data,
            self._numbers.ctypes.data, self._pin_start.ctypes.data, self._pin_column.ctypes.data, self.threads or 1,
            self._levels, self._tile,
        )  # fmt: skip

    def synchronize(self) -> None:
        """Return at once, since a call returns when its steps are done."""

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        state = self._states[self._current]
        state[:2] = position.T.reshape(state[:2].shape)
        state[2:] = velocity.T.reshape(state[2:].shape)

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        flat = self._states[self._current].reshape(4, -1)
        return np.ascontiguousarray(flat[:2].T), np.ascontiguousarray(flat[2:].T)
