"""Launches of the position-based kernels in shared memory, for a gpu_backend.xpbd.solver.PositionBased."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.gpu_backend.core.device import Arguments
from softlab.gpu_backend.core.launch import prepare
from softlab.gpu_backend.position_based.kernels import multiplier_planes
from softlab.gpu_backend.xpbd.choice import Choice
from softlab.gpu_backend.xpbd.sweep import shared_bytes
from softlab.gpu_backend.xpbd.tiled import make_one_block, make_tiled

MAX_ITERATIONS = 1 << 14  # of one launch of `one-block`, which cannot be interrupted: a few 10 ms


class BlockLauncher:
    """Launches of `one-block`: steps of the current buffers, in place."""

    def __init__(self, simulation: Any, choice: Choice):
        assert choice.tile is not None
        self.simulation, self.tile = simulation, choice.tile
        parts = simulation.plan.parts
        variant = simulation.real, simulation.options.math, parts, simulation.scene.dimensions
        self._kernel = make_one_block(*variant, self.tile)
        self._shared = shared_bytes(simulation.real, parts, self.tile)
        prepare(self._kernel, self._arguments(1), self._shared)

    def _arguments(self, steps: int) -> Arguments:
        sim, method = self.simulation, self.simulation.scene.method
        return (
            sim.position[sim._current], sim.velocity[sim._current], sim.anchors, sim.reaches, np.int32(sim.attachments),
            sim.record, sim.bodies, sim.integers, sim._counter, np.int64(steps), np.int64(method.substeps),
            np.int64(method.iterations), *sim.shape,
        )  # fmt: skip

    def advance(self, steps: int) -> None:
        sim, method = self.simulation, self.simulation.scene.method
        most = max(1, MAX_ITERATIONS // (method.substeps * method.iterations))
        while steps:
            some = min(steps, most)
            self._kernel[1, self.tile.threads, sim.stream, self._shared](*self._arguments(some))
            sim._count_on(some)
            steps -= some


class TiledLauncher:
    """Launches of the kernel `tiled`: one substep each, from the current buffers into the others."""

    def __init__(self, simulation: Any, choice: Choice):
        assert choice.tile is not None
        self.simulation, self.tile, self.depth = simulation, choice.tile, choice.depth
        parts, tile = simulation.plan.parts, self.tile
        variant = simulation.real, simulation.options.math, parts, simulation.scene.dimensions
        self._kernel = make_tiled(*variant, tile)
        self._shared = shared_bytes(simulation.real, parts, tile)
        rows, columns = simulation.body.rows, simulation.body.columns
        self._blocks = (tile.columns.count(columns), tile.rows.count(rows))
        more = max(1, multiplier_planes(parts) * simulation.particle_count)
        self._planes = [
            simulation.multipliers, simulation.zeros(more, simulation.real)
        ]  # fmt: skip
        prepare(self._kernel, self._arguments(0, 0, 0, 1), self._shared)

    @property
    def launches(self) -> int:
        """Number of launches of a substep."""
        return -(-self.simulation.scene.method.iterations // self.depth)

    def _arguments(self, place: int, substep: int, launch: int, launches: int) -> Arguments:
        sim, method = self.simulation, self.simulation.scene.method
        now = sim._current
        ahead = (launches - 1 - launch) % 2  # the last launch writes the new state, those before it alternate
        buffers = sim.position[1 - now], sim.scratch
        left = method.iterations - launch * self.depth
        return (
            sim.position[now], sim.velocity[now], buffers[1 - ahead], buffers[ahead], sim.velocity[1 - now],
            self._planes[launch % 2], self._planes[1 - launch % 2], sim.anchors, sim.reaches, np.int32(sim.attachments),
            sim.record, sim.bodies, sim.integers, sim._counter, np.int64(place), np.int64(method.substeps),
            np.int64(substep), np.int32(launch == 0), np.int32(launch == launches - 1),
            np.int64(min(left, self.depth)), *sim.shape,
        )  # fmt: skip

    def substep(self, place: int, substep: int) -> None:
        sim, launches = self.simulation, self.launches
        for launch in range(launches):
            self._kernel[self._blocks, self.tile.threads, sim.stream, self._shared](
                *self._arguments(place, substep, launch, launches)
            )
        sim._current = 1 - sim._current
