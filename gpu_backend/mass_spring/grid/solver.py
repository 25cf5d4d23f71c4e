"""The mass-spring grid on CUDA, one thread per mass, the state on the device throughout.

Kernels, by speed: `stages` (stage by stage), `launch` (one pass over the grid per step, launched from Python), `graph`
(the same passes captured once as a CUDA graph and replayed), `tiles` (several steps per pass), `resident` (the grid on
the chip) and `one-block` (a small grid in one block); mass_spring/grid/choice.py chooses the fastest for a grid. In
`exact` math all give the same bits as the CPU. Memory is allocated with plain allocations, never managed memory.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.launch import Graphs, can_capture
from softlab.gpu_backend.core.sheet import BLOCK
from softlab.gpu_backend.mass_spring.grid.choice import best_tile, default_kernel, named_tile
from softlab.gpu_backend.mass_spring.grid.kernels import make_passes, make_rk4_stages, make_tools
from softlab.gpu_backend.mass_spring.grid.stages import bind_stages
from softlab.gpu_backend.mass_spring.grid.tile_launch import TileLauncher
from softlab.gpu_backend.mass_spring.passes import SheetPasses
from softlab.model.base.errors import SceneError
from softlab.model.core.options import unknown_kernel
from softlab.model.core.own_forces import EXTERNAL_SEED, FIRST, in_window, particle_forces_change
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import Scene

KERNELS = ("one-block", "resident", "tiles", "graph", "launch", "stages")
ON_TILES = ("one-block", "resident", "tiles")


class MassSpring(SheetPasses):
    """The grid on CUDA; model/core/simulation.py defines the contract. `threads` is the number of threads per block."""

    _tiles: TileLauncher | None = None

    def __init__(self, scene: Scene, options: Options):
        super().__init__(scene, options)
        self._choose_kernel()
        self.plan = in_window(mass_spring_plan(scene, options.live), options.first_particle)
        self.threads = self.tile.threads if self.tile else BLOCK[0] * BLOCK[1]
        self._pair = np.complex64 if self.real is np.float32 else np.complex128
        arrays = 14 if self._is_rk4 else 10 if self.kernel == "resident" else 6
        needed = arrays * self.particle_count * np.dtype(self._pair).itemsize
        self._require_memory(needed, "grid.rows x grid.columns", f"{self.body.rows} x {self.body.columns}")
        self._require_rows("grid")
        self._start()

    def _choose_kernel(self) -> None:
        """Set `kernel` and, for kernels on tiles, `tile`. Raises SceneError for a kernel that cannot run this scene."""
        rows, columns = self.body.rows, self.body.columns
        if self.options.kernel is None:
            self.kernel, self.tile, _ = default_kernel(self.scene, self.real)
        else:
            self.kernel, self.tile = named_tile(self.options.kernel)
        if self.kernel not in KERNELS or (self.tile and self.kernel not in ON_TILES):
            raise unknown_kernel(self.options.kernel, KERNELS, "on the gpu")
        if self.kernel == "graph" and not can_capture():
            raise SceneError("--kernel", "graph", "the CUDA simulator cannot capture graphs; use launch")
        if self.kernel in ON_TILES:
            if self._is_rk4:
                raise SceneError(
                    "--kernel",
                    self.kernel,
                    "supports integrators with one force evaluation per step, not rk4; use graph",
                )
            if self.scene.springs and self.scene.springs.alternate:
                raise SceneError(
                    "--kernel",
                    self.kernel,
                    "supports one stiffness, not alternating springs; use graph, launch or stages",
                )
            self.tile = self.tile or best_tile(self.kernel, rows, columns, self.real)
            if self.tile is None:
                raise SceneError(
                    "--kernel", self.kernel, f"{rows} x {columns} masses do not fit on this GPU; use tiles or graph"
                )

    def new_array(self) -> DeviceArray:
        """Return a complex (particles,) device array of zeros."""
        return self.zeros(self.particle_count, self._pair)

    def _allocate(self) -> None:
        self._integers = np.zeros(3, np.uint64)  # of model/core/own_forces.py
        self._integers[EXTERNAL_SEED] = self.scene.external.seed if self.scene.external else 0
        self._integers[FIRST] = self.options.first_particle or 0
        self._allocate_state()
        pinned = (self.body.inverse_mass == 0).astype(np.uint8)
        if not len(self.body.pinned):
            pinned = np.zeros(1, np.uint8)  # a scene without pins has no such array
            rows_pinned = pinned
        else:
            rows_pinned = pinned.reshape(self.body.rows, -1).max(axis=1)
        self.pinned, self._pinned_row = self.on_device(pinned), self.on_device(rows_pinned)
        self._counts = particle_forces_change(self.plan.parts)

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        self._tools = make_tools(self.real)
        math, integrator, parts = self.options.math, self.scene.method.integrator, self.plan.parts
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_stages(self))
            return
        if self.tile:
            self._tiles = TileLauncher(self, self.kernel, self.tile)
        if self.kernel == "one-block":
            self._executor = Executor(self.plan, {}, self._advance_block)
            self._advance_block(0, 1)
            return
        if self._is_rk4:
            self._rk4 = make_rk4_stages(self.real, math, parts)
            self._allocate_rk4()
            launch, fused = self._launch_rk4, self._advance_steps
        else:
            self._passes = make_passes(self.real, math, integrator, parts)
            launch = self._launch_passes
            fused = self._advance_verlet if "middle" in self._passes else self._advance_steps
        self._launch = launch
        self._executor = Executor(self.plan, {}, fused)
        if self.kernel in ("graph", "tiles", "resident") and can_capture():
            fused(0, 3)
            cuda.synchronize()
        if self.kernel == "graph":
            self._graphs = Graphs(self.stream, launch, self._count_on)
        elif self.kernel == "tiles" and self._tiles is not None and can_capture():
            halo = self._tiles.tile.halo
            self._graphs = Graphs(self.stream, self._tiles.launch_captured, lambda many: self._count_on(many * halo))

    # ------------------------------------------------------------------ passes

    def _constants(self, number: int) -> Arguments:
        return (
            self.record, self.integers, self._counter, np.int64(number), self._pinned_row, self.pinned, *self.shape,
        )  # fmt: skip

    def _advance_block(self, step: int, steps: int) -> None:
        self._set_counter(step)
        assert self._tiles is not None
        self._tiles.launch(0, steps + 1 if self.scene.method.integrator == "velocity-verlet" else steps)

    # ------------------------------------------------------------------ the contract

    def _to_host(self, array: DeviceArray) -> np.ndarray:
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return host.view(self.real).reshape(-1, 2)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for array, values in ((self.position[self._current], position), (self.velocity[self._current], velocity)):
            array.copy_to_device(np.ascontiguousarray(values).view(self._pair).reshape(-1), stream=self.stream)
        self.synchronize()
