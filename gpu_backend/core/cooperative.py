"""A kernel that does whole steps, with all blocks launched together: they synchronise at barriers, without the host."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel
from softlab.gpu_backend.core.device import Arguments, simulated
from softlab.gpu_backend.core.launch import prepare
from softlab.gpu_backend.core.simulation import CudaSimulation

STEPS = 64  # per launch, so that it can be interrupted


class Cooperative:
    """Launches `kernel` with `arguments(steps)`, in at most `most` blocks of `threads`: as many as the device runs at
    once. The arguments include `flags` (1,) int32, 0 before each launch."""

    def __init__(
        self, simulation: CudaSimulation, kernel: Kernel, arguments: Callable[[int], Arguments], most: int, threads: int
    ):
        self.flags = cuda.to_device(np.zeros(1, np.int32), stream=simulation.stream)
        self._simulation, self._kernel, self._arguments, self._threads = simulation, kernel, arguments, threads
        self._most = most

    def prepare(self) -> None:
        """Compile the kernel, and query how many blocks fit, once its arguments exist."""
        self.blocks = 1
        if not simulated():
            arguments = self._arguments(1)
            prepare(self._kernel, arguments, 0, cooperative=True)
            compiled = self._kernel.compile(tuple(self._kernel.typeof_pyval(argument) for argument in arguments))
            self.blocks = min(self._most, compiled.max_cooperative_grid_blocks(self._threads))

    def advance(self, step: int, steps: int) -> None:
        sim = self._simulation
        sim._set_counter(step)
        while steps > 0:
            now = min(steps, STEPS)
            self.flags.copy_to_device(np.zeros(1, np.int32), stream=sim.stream)
            self._kernel[self.blocks, self._threads, sim.stream](*self._arguments(now))
            sim._count_on(now)
            steps -= now
