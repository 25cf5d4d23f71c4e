"""The grid in NVIDIA Warp, as in its documentation: one kernel, one thread per mass, arrays of two-vectors.

256 steps are captured in a graph, also on the CPU, where Warp runs on one thread.
"""

# No `from __future__ import annotations`: Warp reads the types of a kernel from its annotations.

from functools import cache
from typing import Any

from softlab.bench.peers.base import GridConstants, Opened
from softlab.bench.peers.warp_base import ReplayedSheet, WarpPeer, load_warp, numbers
from softlab.model.scene.scene import Scene


@cache
def _make_kernel(precision: str) -> Any:
    wp = load_warp()
    real, pair = numbers(precision, 2)

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
    """One thread per mass, one step per launch."""

    kind, title = "warp", "Warp"

    def opened(self, scene: Scene, precision: str) -> Opened:
        constants, kernel = GridConstants(scene, precision), _make_kernel(precision)
        return ReplayedSheet(constants, precision, self.backend, 2, kernel, list(constants.in_order))
