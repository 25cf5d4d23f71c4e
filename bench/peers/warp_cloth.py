"""The cloth of springs in NVIDIA Warp: one kernel, one thread per mass that gathers its up to twelve forces.

Arrays of three-vectors; semi-implicit Euler. Replayed like the grid (warp_base.py).
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

from softlab.bench.peers.base import Opened
from softlab.bench.peers.cuda_cpp_cloth import ClothConstants, cloth_refusal
from softlab.bench.peers.warp_base import ReplayedSheet, WarpPeer, load_warp, numbers
from softlab.model.scene.scene import Scene


@cache
def _make_kernel(precision: str) -> Any:
    wp = load_warp()
    real, vector = numbers(precision, 3)

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
        """Return the force over mass from the mass (i, j), or 0 if there is none.

        `spring`: stiffness, stiffness times rest length, damping, all over mass.
        """
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
            sign = 2 * side - 1
            a += pull(position, velocity, i, j + sign, p, v, structural)
            a += pull(position, velocity, i + sign, j, p, v, structural)
            a += pull(position, velocity, i + sign, j - 1, p, v, shear)
            a += pull(position, velocity, i + sign, j + 1, p, v, shear)
            a += pull(position, velocity, i, j + 2 * sign, p, v, bending)
            a += pull(position, velocity, i + 2 * sign, j, p, v, bending)
        w = v + dt * a
        if free[i, j] != wp.uint8(0):
            new_position[i, j] = p + dt * w
            new_velocity[i, j] = w
        else:
            new_position[i, j] = p
            new_velocity[i, j] = vector(real(0.0))

    return cloth_step


class WarpCloth(WarpPeer):
    """One thread per mass, one step per launch."""

    kind, title = "warp_cloth", "Warp"
    scenes = ("cloth",)

    def refusal(self, scene: Scene) -> str | None:
        return cloth_refusal(scene)

    def opened(self, scene: Scene, precision: str) -> Opened:
        constants, kernel = ClothConstants(scene, precision), _make_kernel(precision)
        *springs, damping, gravity, dt = constants.in_order
        _, vector = numbers(precision, 3)
        inputs = [*(vector(*springs[3 * kind : 3 * kind + 3]) for kind in range(3)), damping, gravity, dt]
        return ReplayedSheet(constants, precision, self.backend, 3, kernel, inputs)
