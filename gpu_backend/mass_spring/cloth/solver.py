"""The mass-spring cloth on CUDA, one thread per mass, the state on the device throughout.

Kernels, by speed: `stages` (stage by stage), `launch` (one pass over the sheet per step, launched from Python), `graph`
(the same passes captured once as a CUDA graph and replayed), `resident` (the sheet on the chip) and `one-block` (a
small sheet in one block); mass_spring/cloth/choice.py chooses one. In `exact` math all give the same bits as the CPU.
Memory is allocated with plain allocations.
"""

from __future__ import annotations

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.pins import pin_marks
from softlab.gpu_backend.core.device import Arguments, simulated
from softlab.gpu_backend.core.launch import Graphs, prepare
from softlab.gpu_backend.core.quads import SIZE
from softlab.gpu_backend.core.sheet import BLOCK, make_cloth_tools
from softlab.gpu_backend.mass_spring.cloth.block import block_bytes, block_threads, make_cloth_block
from softlab.gpu_backend.mass_spring.cloth.choice import cloth_kernel, cloth_tile
from softlab.gpu_backend.mass_spring.cloth.implicit import THREADS as IMPLICIT_THREADS
from softlab.gpu_backend.mass_spring.cloth.implicit import ImplicitSteps, implicit_kernel
from softlab.gpu_backend.mass_spring.cloth.kernels import make_cloth_passes, make_cloth_rk4_stages
from softlab.gpu_backend.mass_spring.cloth.launch import ClothTiles
from softlab.gpu_backend.mass_spring.cloth.stages import bind_cloth_stages
from softlab.gpu_backend.mass_spring.passes import QuadPasses
from softlab.model.contact.cloth_parameters import body_rows, pin_velocity
from softlab.model.core.integrators import IMPLICIT
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.mass_spring.cloth_plan import cloth_plan, kicks_coupled
from softlab.model.scene.scene import Scene


class ClothMassSpring(QuadPasses):
    """The cloth on CUDA; model/core/simulation.py defines the contract. `threads` is the number of threads per block.
    `implicit`: further arrays of implicit Euler, else None."""

    implicit: ImplicitSteps | None = None

    def __init__(self, scene: Scene, options: Options):
        super().__init__(scene, options)
        self.plan = cloth_plan(scene, options.live)
        self._is_implicit = scene.method.integrator in IMPLICIT
        choose = implicit_kernel if self._is_implicit else cloth_kernel
        self.kernel = choose(scene, self.real, self.plan.parts, options.kernel)
        self.tile = cloth_tile(scene, self.real, self.plan.parts, self.kernel, options.kernel)
        self.threads = block_threads(self.particle_count) if self.kernel == "one-block" else BLOCK[0] * BLOCK[1]
        if self._is_implicit:
            self.threads = IMPLICIT_THREADS
        elif self.tile:
            self.threads = self.tile.threads
        arrays = 15 if self._is_implicit else 12 if self._is_rk4 else 12 if self.kernel == "resident" else 6
        needed = arrays * self.particle_count * SIZE * np.dtype(self.real).itemsize
        self._require_memory(needed, "cloth.rows x cloth.columns", f"{self.body.rows} x {self.body.columns}")
        self._require_rows("cloth")
        self._start()

    def _allocate(self) -> None:
        rows, self._first_pin = body_rows(self.scene, self.body, self.real)
        self._rows, self._weight = rows, pin_marks(self.body, rows, self._first_pin)
        self._allocate_quads(rows)

    def _build(self) -> None:
        """Compile and load every kernel, by running it once on arrays that `reset` then overwrites."""
        self._tools = make_cloth_tools(self.real)
        variant = self.real, self.options.math, self.scene.method.integrator, self.plan.parts
        if self._is_implicit:
            self.implicit = ImplicitSteps(self)
            self._executor = Executor(self.plan, {}, self.implicit.advance)
            return
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_cloth_stages(self))
            return
        if self._is_rk4:
            self._rk4 = make_cloth_rk4_stages(self.real, self.options.math, self.plan.parts)
            self._allocate_rk4()
            self._launch, fused = self._launch_rk4, self._advance_steps
        else:
            self._passes = make_cloth_passes(*variant)
            verlet, coupled_kicks = "middle" in self._passes, kicks_coupled(self.plan.parts)
            self._launch = self._launch_passes if coupled_kicks or not verlet else self._launch_pairs
            fused = self._advance_verlet if coupled_kicks and verlet else self._advance_steps
        if self.tile:
            self._tiles = ClothTiles(self, self.kernel, self.tile)
        if self.kernel == "one-block":
            self._block = make_cloth_block(*variant, self.threads)
            self._shared = block_bytes(self.real, self.plan.parts, self.particle_count)
            prepare(self._block, self._block_arguments(1), self._shared)
        self._executor = Executor(self.plan, {}, fused)
        if not simulated():
            fused(0, 3)
            cuda.synchronize()
        if self.kernel == "graph":
            self._graphs = Graphs(self.stream, self._launch, self._count_on)

    # ------------------------------------------------------------------ passes

    def _constants(self, number: int) -> Arguments:
        return (
            self.record, self.bodies, self.integers, self._counter, np.int64(number), *self.shape,
        )  # fmt: skip

    def _launch_pairs(self, parity: int, count: int) -> None:
        """Launch whole steps of velocity Verlet whose kicks cannot be combined."""
        self._current = parity
        for number in range(count):
            self._pass("opening", number)
            self._pass("closing", number + 1)

    def _block_arguments(self, passes: int) -> Arguments:
        constants = (self.record, self.bodies, self.integers, self._counter)
        return (*self.states(), *constants, np.int64(0), np.int64(passes), *self.shape)

    def _launch_on_chip(self, count: int) -> None:
        if self._tiles is not None:
            super()._launch_on_chip(count)
            return
        self._block[1, self.threads, self.stream, self._shared](*self._block_arguments(count))
        self._current = 1 - self._current

    # ------------------------------------------------------------------ the contract

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if self.implicit is not None:
            self.implicit.renew()

    def _pin_velocity(self, step: int) -> np.ndarray | float:
        if "motion" not in self.plan.parts:
            return 0
        return pin_velocity(self._rows, self._first_pin, len(self.body.pinned), step, self._record)
