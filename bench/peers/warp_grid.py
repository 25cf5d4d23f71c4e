"""The grid in NVIDIA Warp, as its documentation teaches: one kernel, one thread a mass, arrays of two-vectors.

256 steps are captured in a graph, also on the CPU, where Warp runs on one thread.
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

import numpy as np

from bench.peers.base import GridConstants, Opened
from bench.peers.warp_base import Replayed, WarpPeer, load_warp
from model.scene.scene import Scene


@cache
def _make_kernel(precision: str) -> Any:
    wp = load_warp()
    real, pair = (wp.float32, wp.vec2f) if precision == "float32" else (wp.float64, wp.vec2d)

    @wp.func
    def pull(here: pair, neighbour: pair, stiffness: real, stiffness_rest: real):
        offset = neighbour - here
        length = wp.length(offset)
        scale = real(0.0)
        if length > real(0.0):
            scale = stiffness - stiffness_rest / length
        return scale * offset

    @wp.kernel(enable_backward=False, module="unique", module_options={"fast_math": True})
    def grid_step(
        position: wp.array2d(dtype=pair),
        velocity: wp.array2d(dtype=pair),
        free: wp.array2d(dtype=wp.uint8),
        stiffness: real,
        stiffness_rest: real,
        damping: real,
        gravity: real,
        dt: real,
        half_dt_squared: real,
        new_position: wp.array2d(dtype=pair),
        new_velocity: wp.array2d(dtype=pair),
    ):
        i, j = wp.tid()
        p = position[i, j]
        v = velocity[i, j]
        acceleration = pair(real(0.0), gravity) - damping * v
        if j + 1 < position.shape[1]:
            acceleration += pull(p, position[i, j + 1], stiffness, stiffness_rest)
        if j > 0:
            acceleration += pull(p, position[i, j - 1], stiffness, stiffness_rest)
        if i + 1 < position.shape[0]:
            acceleration += pull(p, position[i + 1, j], stiffness, stiffness_rest)
        if i > 0:
            acceleration += pull(p, position[i - 1, j], stiffness, stiffness_rest)
        moved = p + dt * v + half_dt_squared * acceleration
        if free[i, j] != wp.uint8(0):
            new_position[i, j] = moved
            new_velocity[i, j] = (moved - p) / dt
        else:
            new_position[i, j] = p
            new_velocity[i, j] = pair(real(0.0), real(0.0))

    return grid_step


class WarpGrid(WarpPeer):
    """One thread a mass, one step a launch."""

    kind, title = "warp", "Warp"

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Grid(GridConstants(scene, precision), precision, self.backend)


class _Grid(Replayed):
    def __init__(self, constants: GridConstants, precision: str, backend: str):
        super().__init__(backend)
        wp = self._wp
        self.constants = constants
        pair = wp.vec2f if precision == "float32" else wp.vec2d
        self._shape = (constants.rows, constants.columns)
        zeros = {"shape": self._shape, "dtype": pair, "device": self._device}
        self._position, self._velocity = ([wp.zeros(**zeros) for _ in range(2)] for _ in range(2))
        self._free = wp.array(constants.free.astype(np.uint8), dtype=wp.uint8, device=self._device)
        self._kernel = _make_kernel(precision)
        wp.load_module(self._kernel.module, device=self._device)  # nothing may be loaded while a graph is captured
        self._launches = [self._recorded(0), self._recorded(1)]
        self._capture()
        self.load(constants.position, constants.velocity)

    def _recorded(self, source: int) -> Any:
        target = 1 - source
        return self._wp.launch(
            self._kernel,
            dim=self._shape,
            inputs=[self._position[source], self._velocity[source], self._free, *self.constants.in_order],
            outputs=[self._position[target], self._velocity[target]],
            device=self._device,
            record_cmd=True,
        )

    def _step(self) -> None:
        self._launches[self._current].launch()
        self._current = 1 - self._current

    def load(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._current = 0
        for target, array in ((self._position, position), (self._velocity, velocity)):
            shaped = np.ascontiguousarray(array, self.constants.real).reshape(*self._shape, 2)
            target[self._current].assign(shaped)
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = (a[self._current].numpy().reshape(-1, 2) for a in (self._position, self._velocity))
        return position.copy(), velocity.copy()

    def close(self) -> None:
        super().close()
        self._launches.clear()
        self._position, self._velocity = [], []
