"""Common parts of the mass-spring solvers on CUDA: passes over the sheet, from one pair of buffers into the other."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence

import numpy as np

from softlab.gpu_backend.core.compile import Kernel
from softlab.gpu_backend.core.device import Arguments, DeviceArray
from softlab.gpu_backend.core.quad_simulation import QuadSimulation
from softlab.gpu_backend.core.simulation import CudaSimulation
from softlab.gpu_backend.core.tiling import Tile
from softlab.model.base.errors import BackendUnavailable


class SheetPasses(CudaSimulation):
    """Steps of a sheet as passes over it.

    A solver sets `_passes` (kernels by name: `step`, or `opening`, `middle` and `closing` of velocity Verlet), or
    `_rk4` (four kernels, together a step), `_launch` (which launches a number of equal passes) and `_tiles` (of kernels
    on tiles, else None).
    """

    _passes: dict[str, Kernel]
    _rk4: Sequence[Kernel]
    _launch: Callable[[int, int], None]
    pinned: DeviceArray  # of a grid: 1 for each pinned mass
    _tiles: TileLaunches | None = None

    @abstractmethod
    def _constants(self, number: int) -> Arguments:
        """Return the arguments of a pass besides the buffers; `number`: its number after the step counter."""

    def states(self) -> Arguments:
        """Return position and velocity of the current buffer, then those of the other one."""
        source, target = self._current, 1 - self._current
        return self.position[source], self.velocity[source], self.position[target], self.velocity[target]

    def _pass(self, name: str, number: int) -> None:
        """Launch one pass from the current buffer into the other; `number`: its number after the step counter."""
        self._passes[name][self._grid](*self.states(), *self._constants(number))
        self._current = 1 - self._current

    def _launch_passes(self, parity: int, count: int) -> None:
        self._current = parity
        name = "middle" if "middle" in self._passes else "step"
        for number in range(count):
            self._pass(name, number)

    def _allocate_rk4(self) -> None:
        """Allocate two states of stages, and the sums."""
        self._stage_p, self._stage_v = [self.new_array() for _ in range(2)], [self.new_array() for _ in range(2)]
        self._total_p, self._total_v = self.new_array(), self.new_array()

    def _launch_rk4(self, parity: int, count: int) -> None:
        base = (self.position[0], self.velocity[0])
        stages = (
            (self._stage_p[0], self._stage_v[0]), (self._stage_p[1], self._stage_v[1]),
            (self._stage_p[0], self._stage_v[0]), base,
        )  # fmt: skip
        for number in range(count):
            source = base
            for kernel, target in zip(self._rk4, stages, strict=True):
                kernel[self._grid](*source, *base, self._total_p, self._total_v, *target, *self._constants(number))
                source = target

    def _many(self, count: int) -> None:
        """Launch `count` equal passes (steps of RK4) with the chosen kernel."""
        tiles = self._tiles
        if tiles is None and self.kernel != "one-block":
            self._repeat(count, self._launch, 1)
            return
        if self.kernel == "tiles" and tiles is not None:
            halo = tiles.tile.halo
            launches, count = divmod(count, halo)
            self._repeat(launches, tiles.launch_many, halo)
        if count:
            self._launch_on_chip(count)
            self._count_on(count)

    def _launch_on_chip(self, count: int) -> None:
        """Do `count` passes in one launch, with the sheet, or a tile of it, on the chip."""
        assert self._tiles is not None
        self._tiles.launch(0, count)

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

    def close(self) -> None:
        super().close()
        if self._tiles is not None:
            self._tiles.close()


class QuadPasses(SheetPasses, QuadSimulation):
    """Steps of a sheet whose state is quads, as passes over it."""


class TileLaunches:
    """The launches of a `kernel` on tiles for one simulation, from its current state into the other buffer, which
    becomes the current one. Subclasses set `_kernel` and `_grid`."""

    _kernel: Kernel
    _grid: tuple

    def __init__(self, simulation: SheetPasses, kernel: str, tile: Tile):
        self.simulation, self.kernel, self.tile, self._epoch = simulation, kernel, tile, 0
        self._failed = simulation.zeros(1, np.int32)  # 1 if a block of `resident` timed out waiting for others

    @abstractmethod
    def _arguments(self, number: int, passes: int) -> Arguments:
        """Return the kernel's arguments for `passes` passes, the first of which is `number` after the step counter."""

    def launch(self, number: int, passes: int) -> None:
        """Launch `passes` passes, the first of which is `number` after the step counter."""
        self._kernel[self._grid](*self._arguments(number, passes))
        self.simulation._current = 1 - self.simulation._current
        if self.kernel == "resident":
            exchanges = (passes - 1) // self.tile.halo
            self._epoch = (self._epoch + exchanges + 2**31) % 2**32 - 2**31  # compared by difference: may wrap around

    def launch_many(self, parity: int, count: int) -> None:
        """Do `count` launches of as many passes as the halo of the tile allows, the first from the buffer `parity`."""
        self.simulation._current = parity
        for number in range(count):
            self.launch(number * self.tile.halo, self.tile.halo)

    def close(self) -> None:
        """Free the bands; nothing may be running."""

    def require_exchange(self) -> None:
        """Raise BackendUnavailable if a block of `resident` timed out waiting for others."""
        if self.kernel == "resident" and self.simulation.fetch(self._failed) != 0:
            self._failed.copy_to_device(np.zeros(1, np.int32), stream=self.simulation.stream)
            raise BackendUnavailable(
                "the blocks of kernel resident did not run together (is the GPU shared?)", "use --kernel graph"
            )
