"""The cloth of springs in NVIDIA Warp: one kernel, one thread a mass that gathers the pulls of its up to twelve neighbours,
arrays of three-vectors; semi-implicit Euler. Replayed as the grid's (warp_base.py)."""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

import numpy as np

from bench.peers.base import Opened
from bench.peers.cuda_cpp_cloth import ClothConstants, cloth_refusal
from bench.peers.warp_base import Replayed, WarpPeer, load_warp
from model.scene.scene import Scene


@cache
def _make_kernel(precision: str) -> Any:
    wp = load_warp()
    real, vector = (wp.float32, wp.vec3f) if precision == "float32" else (wp.float64, wp.vec3d)

    @wp.func
    def pull(
        position: wp.array2d(dtype=vector),
        velocity: wp.array2d(dtype=vector),
        i: int,
        j: int,
        p: vector,
        v: vector,
        spring: vector,
    ):
        """From the mass (i, j), if there is one; `spring`: stiffness, times the rest length, damping, all over mass."""
        result = vector(real(0.0))
        if i >= 0 and i < position.shape[0] and j >= 0 and j < position.shape[1]:
            offset = position[i, j] - p
            squared = wp.dot(offset, offset)
            if squared > real(0.0):
                scale = spring[0] - spring[1] / wp.sqrt(squared)
                if spring[2] > real(0.0):
                    scale += spring[2] * wp.dot(velocity[i, j] - v, offset) / squared
                result = scale * offset
        return result

    @wp.kernel(enable_backward=False, module="unique", module_options={"fast_math": True})
    def cloth_step(
        position: wp.array2d(dtype=vector),
        velocity: wp.array2d(dtype=vector),
        free: wp.array2d(dtype=wp.uint8),
        structural: vector,
        shear: vector,
        bending: vector,
        damping: real,
        gravity: real,
        dt: real,
        new_position: wp.array2d(dtype=vector),
        new_velocity: wp.array2d(dtype=vector),
    ):
        i, j = wp.tid()
        p = position[i, j]
        v = velocity[i, j]
        a = vector(real(0.0), gravity, real(0.0)) - damping * v
        for side in range(2):
            way = 2 * side - 1
            a += pull(position, velocity, i, j + way, p, v, structural)
            a += pull(position, velocity, i + way, j, p, v, structural)
            a += pull(position, velocity, i + way, j - 1, p, v, shear)
            a += pull(position, velocity, i + way, j + 1, p, v, shear)
            a += pull(position, velocity, i, j + 2 * way, p, v, bending)
            a += pull(position, velocity, i + 2 * way, j, p, v, bending)
        w = v + dt * a
        if free[i, j] != wp.uint8(0):
            new_position[i, j] = p + dt * w
            new_velocity[i, j] = w
        else:
            new_position[i, j] = p
            new_velocity[i, j] = vector(real(0.0))

    return cloth_step


class WarpCloth(WarpPeer):
    """One thread a mass, one step a launch."""

    kind, title = "warp_cloth", "Warp"
    scenes = ("cloth",)

    def refusal(self, scene: Scene) -> str | None:
        return cloth_refusal(scene)

    def opened(self, scene: Scene, precision: str) -> Opened:
        return _Cloth(ClothConstants(scene, precision), precision, self.backend)


class _Cloth(Replayed):
    def __init__(self, constants: ClothConstants, precision: str, backend: str):
        super().__init__(backend)
        wp = self._wp
        self.constants = constants
        vector = wp.vec3f if precision == "float32" else wp.vec3d
        self._shape = (constants.rows, constants.columns)
        zeros = {"shape": self._shape, "dtype": vector, "device": self._device}
        self._position, self._velocity = ([wp.zeros(**zeros) for _ in range(2)] for _ in range(2))
        self._free = wp.array(constants.free.astype(np.uint8), dtype=wp.uint8, device=self._device)
        *springs, damping, gravity, dt = constants.in_order
        self._numbers = [*(vector(*springs[3 * kind : 3 * kind + 3]) for kind in range(3)), damping, gravity, dt]
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
            inputs=[self._position[source], self._velocity[source], self._free, *self._numbers],
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
            target[0].assign(np.ascontiguousarray(array, self.constants.real).reshape(*self._shape, 3))
        self.synchronize()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        position, velocity = (a[self._current].numpy().reshape(-1, 3) for a in (self._position, self._velocity))
        return position.copy(), velocity.copy()

    def close(self) -> None:
        super().close()
        self._launches.clear()
        self._position, self._velocity = [], []
