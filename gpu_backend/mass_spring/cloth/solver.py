"""The mass-spring cloth on CUDA, one thread per mass, the state on the device throughout.

Kernels, a ladder: `stages` (stage by stage), `launch` (one pass over the sheet a step, launched from Python), `graph` (the
same passes captured once as a CUDA graph and replayed), `tiles` (several steps a pass), `resident` (the sheet kept on the
chip) and `one-block` (a small sheet in one block); mass_spring/cloth/choice.py says which is taken when. In `exact` math
all give the same bits, and the CPU's. Memory is taken with plain allocations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.contact.pins import pin_marks
from gpu_backend.core.device import memory_info, require_gpu, simulated
from gpu_backend.core.launch import Graphs, new_stream, prepare
from gpu_backend.core.quads import SIZE
from gpu_backend.core.simulation import NOTHING_BAD, CudaSimulation
from gpu_backend.mass_spring.cloth.block import block_bytes, block_threads, make_cloth_block
from gpu_backend.mass_spring.cloth.choice import cloth_kernel, cloth_tile
from gpu_backend.mass_spring.cloth.implicit import THREADS as IMPLICIT_THREADS
from gpu_backend.mass_spring.cloth.implicit import ImplicitSteps, implicit_kernel
from gpu_backend.mass_spring.cloth.kernels import make_cloth_passes, make_cloth_rk4_stages, make_cloth_tools
from gpu_backend.mass_spring.cloth.launch import ClothTiles
from gpu_backend.mass_spring.cloth.point import (
    COLLIDER_COUNTS,
    EXTERNAL_SEED,
    INTEGERS,
    WIND_SEED,
    knows_time,
)  # fmt: skip
from gpu_backend.mass_spring.cloth.stages import bind_cloth_stages
from gpu_backend.mass_spring.grid.kernels import BLOCK, MAX_BLOCKS_DOWN
from model.core.errors import SceneError
from model.core.integrators import IMPLICIT
from model.core.memory import require
from model.core.plan import Executor
from model.core.simulation import Options
from model.mass_spring.cloth_parameters import body_rows, pin_velocity
from model.mass_spring.cloth_plan import cloth_plan, kicks_meet
from model.scene.scene import Scene


class ClothMassSpring(CudaSimulation):
    """See model/core/simulation.py for the contract. `threads` is the number of threads a block. `implicit`: what implicit
    Euler needs besides, else None."""

    implicit: ImplicitSteps | None = None
    _tiles: ClothTiles | None = None

    def __init__(self, scene: Scene, options: Options):
        self.device = require_gpu()
        super().__init__(scene, options)
        self.plan = cloth_plan(scene, options.live)
        self._is_implicit = scene.method.integrator in IMPLICIT
        choose = implicit_kernel if self._is_implicit else cloth_kernel
        self.kernel = choose(scene, self.real, self.plan.parts, options.kernel)
        self.tile = cloth_tile(scene, self.real, self.plan.parts, self.kernel, options.kernel)
        rows, columns = self.body.rows, self.body.columns
        self.particle_count = rows * columns
        self.threads = block_threads(self.particle_count) if self.kernel == "one-block" else BLOCK[0] * BLOCK[1]
        if self._is_implicit:
            self.threads = IMPLICIT_THREADS
        elif self.tile:
            self.threads = self.tile.threads
        arrays = 15 if self._is_implicit else 12 if self._is_rk4 else 12 if self.kernel == "resident" else 6
        needed = arrays * self.particle_count * SIZE * np.dtype(self.real).itemsize
        if not simulated():
            require(needed, memory_info()[0], "cloth.rows x cloth.columns", f"{rows} x {columns}", "GPU memory")
        blocks = ((columns + BLOCK[0] - 1) // BLOCK[0], (rows + BLOCK[1] - 1) // BLOCK[1])
        if blocks[1] > MAX_BLOCKS_DOWN:
            most = MAX_BLOCKS_DOWN * BLOCK[1]
            raise SceneError("cloth.rows", rows, f"at most {most} rows on the gpu; turn the sheet")
        self.stream = new_stream()
        self._grid = (blocks, BLOCK, self.stream)
        self._flat = ((self.particle_count + 255) // 256, 256, self.stream)
        self._allocate()
        self._build_or_explain()
        self.reset()

    def new_array(self) -> Any:
        """A device array of quads, zeros."""
        return cuda.to_device(np.zeros(SIZE * self.particle_count, self.real), stream=self.stream)

    def _allocate(self) -> None:
        self.position = [self.new_array(), self.new_array()]
        self.velocity = [self.new_array(), self.new_array()]
        self.kept_position, self.kept_velocity = self.new_array(), self.new_array()
        self._current = 0
        self.record = cuda.to_device(self._record, stream=self.stream)
        scene = self.scene
        kinds = [kind for kind, _ in scene.colliders]
        self._integers = np.zeros(INTEGERS, np.uint64)
        self._integers[EXTERNAL_SEED] = scene.external.seed if scene.external else 0
        self._integers[WIND_SEED] = scene.wind.seed if scene.wind else 0
        for place, kind in COLLIDER_COUNTS:
            self._integers[place] = kinds.count(kind)
        self.integers = cuda.to_device(self._integers, stream=self.stream)
        self._rows, self._first_pin = body_rows(scene, self.body, self.real)
        self.bodies = cuda.to_device(self._rows if len(self._rows) else np.zeros(1, self.real), stream=self.stream)
        self._counter = cuda.to_device(np.zeros(1, np.int64), stream=self.stream)
        self._bad = cuda.to_device(np.full(1, NOTHING_BAD, np.int32), stream=self.stream)
        self._pinned = pin_marks(self.body, self._rows, self._first_pin)
        self.shape = (np.int32(self.body.rows), np.int32(self.body.columns))
        self._counts = knows_time(self.plan.parts)

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
            self._stage_p, self._stage_v = [self.new_array() for _ in range(2)], [self.new_array() for _ in range(2)]
            self._total_p, self._total_v = self.new_array(), self.new_array()
            self._launch, fused = self._launch_rk4, self._advance_steps
        else:
            self._passes = make_cloth_passes(*variant)
            verlet, meet = "middle" in self._passes, kicks_meet(self.plan.parts)
            self._launch = self._launch_passes if meet or not verlet else self._launch_pairs
            fused = self._advance_verlet if meet and verlet else self._advance_steps
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
        elif self.kernel == "tiles" and self._tiles is not None and not simulated():
            halo = self._tiles.tile.halo
            self._graphs = Graphs(self.stream, self._tiles.launch_many, lambda many: self._count_on(many * halo))

    # ------------------------------------------------------------------ passes

    def _pass(self, name: str, number: int) -> None:
        """Launch one pass from the current buffer into the other; `number`: its place after the step counter."""
        source, target = self._current, 1 - self._current
        self._passes[name][self._grid](
            self.position[source], self.velocity[source], self.position[target], self.velocity[target], self.record,
            self.bodies, self.integers, self._counter, np.int64(number), *self.shape,
        )  # fmt: skip
        self._current = target

    def _launch_passes(self, parity: int, count: int) -> None:
        self._current = parity
        name = "middle" if "middle" in self._passes else "step"
        for number in range(count):
            self._pass(name, number)

    def _launch_pairs(self, parity: int, count: int) -> None:
        """Whole steps of velocity Verlet, where its kicks do not meet."""
        self._current = parity
        for number in range(count):
            self._pass("opening", number)
            self._pass("closing", number + 1)

    def _launch_rk4(self, parity: int, count: int) -> None:
        base = (self.position[0], self.velocity[0])
        stages = (
            (self._stage_p[0], self._stage_v[0]),
            (self._stage_p[1], self._stage_v[1]),
            (self._stage_p[0], self._stage_v[0]),
            base,
        )
        for number in range(count):
            source = base
            for kernel, target in zip(self._rk4, stages, strict=True):
                kernel[self._grid](
                    *source, *base, self._total_p, self._total_v, *target, self.record, self.bodies, self.integers,
                    self._counter, np.int64(number), *self.shape,
                )  # fmt: skip
                source = target

    def _block_arguments(self, passes: int) -> tuple[Any, ...]:
        source, target = self._current, 1 - self._current
        return (
            self.position[source], self.velocity[source], self.position[target], self.velocity[target], self.record,
            self.bodies, self.integers, self._counter, np.int64(0), np.int64(passes), *self.shape,
        )  # fmt: skip

    def _many(self, count: int) -> None:
        """`count` equal passes (steps of RK4), by the kernel's own way."""
        tiles = self._tiles
        if self.kernel == "tiles" and tiles is not None:
            launches, count = divmod(count, tiles.tile.halo)
            self._repeat(launches, tiles.launch_many, tiles.tile.halo)
        elif tiles is None and self.kernel != "one-block":
            self._repeat(count, self._launch, 1)
            return
        if not count:
            return
        if tiles is not None:
            tiles.launch(0, count)
        else:
            self._block[1, self.threads, self.stream, self._shared](*self._block_arguments(count))
            self._current = 1 - self._current
        self._count_on(count)

    def _advance_steps(self, step: int, steps: int) -> None:
        self._set_counter(step)
        self._many(steps)

    def _advance_verlet(self, step: int, steps: int) -> None:
        self._set_counter(step)
        self._pass("opening", 0)
        self._count_on(1)
        self._many(steps - 1)
        self._pass("closing", 0)

    # ------------------------------------------------------------------ the contract

    def _first_diverged(self) -> int:
        if self._tiles is not None:
            self._tiles.require_exchange()
        return super()._first_diverged()

    def _to_host(self, array: Any) -> np.ndarray:
        host = array.copy_to_host(stream=self.stream)
        self.synchronize()
        return np.ascontiguousarray(host.reshape(-1, SIZE)[:, :3])

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if self.implicit is not None:
            self.implicit.renew()

    def _pin_velocity(self, step: int) -> Any:
        if "motion" not in self.plan.parts:
            return 0
        return pin_velocity(self._rows, self._first_pin, len(self.body.pinned), step, self._record)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        for array, values, spare in (
            (self.position[self._current], position, self._pinned),
            (self.velocity[self._current], velocity, np.zeros_like(self._pinned)),
        ):
            quads = np.concatenate([values, spare[:, None]], axis=1).astype(self.real, copy=False)
            array.copy_to_device(np.ascontiguousarray(quads).reshape(-1), stream=self.stream)
        self.synchronize()
