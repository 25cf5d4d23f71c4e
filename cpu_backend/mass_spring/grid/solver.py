"""The mass-spring grid on CPU threads.

Four kernels of increasing speed: `stages` (stage by stage over the whole grid, the teaching version), `fused` (one pass
over the grid per step), `team` (no parallel region per step) and `tiled` (several steps per pass), each in its own
file; mass_spring/grid/choice.py chooses one. In `exact` math all give the same bits, for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros, padded, plain
from softlab.cpu_backend.core.progress import new_flags
from softlab.cpu_backend.core.simulation import RowsSimulation
from softlab.cpu_backend.mass_spring.arrays import Passes, Sheet
from softlab.cpu_backend.mass_spring.grid.choice import choose_kernel, tiling
from softlab.cpu_backend.mass_spring.grid.kernels import SCRATCH_ROWS, make_advance
from softlab.cpu_backend.mass_spring.grid.persistent import TEAM_FLAGS, TEAM_SCRATCH_ROWS, make_team_advance
from softlab.cpu_backend.mass_spring.grid.rk4 import make_advance_rk4
from softlab.cpu_backend.mass_spring.grid.row_step import CLOSING, MIDDLE, OPENING
from softlab.cpu_backend.mass_spring.grid.stages import bind_stages
from softlab.cpu_backend.mass_spring.grid.tiled import make_tiled_advance
from softlab.model.core.own_forces import in_window
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.mass_spring.plan import mass_spring_plan
from softlab.model.scene.scene import Scene


class MassSpring(RowsSimulation):
    """The grid on CPU threads; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a
    number."""

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel = choose_kernel(scene, self.real, options.kernel)
        self.plan = in_window(mass_spring_plan(scene, options.live), options.first_particle)
        rows, columns = self.body.rows, self.body.columns
        self.integers = np.append(self._seeds(2), np.uint64(options.first_particle or 0))
        self._layout = plain(rows, columns) if self.kernel == "stages" else padded(rows, columns, self.real)
        self._integers_of_layout = self._layout.integers()
        self._states = aligned_zeros((4 if self._is_rk4 else 2) * self._layout.size, self.real)
        self._current = 0
        self._snapshot = np.zeros(self._layout.size, self.real)
        self._set_pins()
        self._bands = min(self.threads, rows)
        self._executor = self._make_executor()
        self.reset()

    def _make_executor(self) -> Executor:
        """Make the kernel, compiled or from the cache, and its scratch memory."""
        if self.kernel == "stages":
            return Executor(self.plan, bind_stages(self))
        bands, width = self._bands, self._layout.stride
        make: Callable = {"fused": make_advance, "team": make_team_advance, "tiled": make_tiled_advance}[self.kernel]
        variant = self.real, self.options.math, self.scene.method.integrator, self.plan.parts
        scratch = bands * width * (TEAM_SCRATCH_ROWS if self.kernel == "team" else SCRATCH_ROWS)
        if self.kernel == "team":
            self._progress = new_flags(TEAM_FLAGS * bands)
        elif self.kernel == "tiled":
            self._tiling = tiling(self.real, self._layout.columns)
            scratch = bands * self._tiling.scratch
        self._scratch = aligned_zeros(scratch, self.real).reshape(bands, -1)
        if self._is_rk4:
            self._kernel = make_advance_rk4(self.real, self.options.math, self.plan.parts)
            return Executor(self.plan, {}, self._advance_rk4)
        self._kernel = make(*variant)
        run = {"fused": self._advance_fused, "team": self._advance_team, "tiled": self._advance_tiled}[self.kernel]
        return Executor(self.plan, {}, run)

    def _passes(self, step: int, steps: int) -> tuple[Passes, np.ndarray, int, Sheet, np.ndarray]:
        """Return the first arguments of every kernel of one-force integrators and velocity Verlet."""
        verlet = self.scene.method.integrator == "velocity-verlet"
        first, last = (OPENING, CLOSING) if verlet else (MIDDLE, MIDDLE)
        return Passes(steps + verlet, first, last, step), self._states, self._current, self._sheet, self._scratch

    @property
    def _sheet(self) -> Sheet:
        return Sheet(self._integers_of_layout, self.parameters, self.integers, self._pin_start, self._pin_column)

    def _advance_fused(self, step: int, steps: int) -> None:
        arguments = self._passes(step, steps)
        self._kernel(self._bands, *arguments)
        self._current = (self._current + arguments[0].number) % 2

    def _advance_team(self, step: int, steps: int) -> None:
        arguments = self._passes(step, steps)
        self._progress.fill(0)
        self._kernel(self._bands, *arguments, self._progress)
        self._current = (self._current + arguments[0].number) % 2

    def _advance_tiled(self, step: int, steps: int) -> None:
        arguments, tiles = self._passes(step, steps), self._tiling
        self._kernel(self._bands, *arguments, tiles)
        self._current = (self._current - -arguments[0].number // tiles.levels) % 2  # states are swapped once per levels

    def _advance_rk4(self, step: int, steps: int) -> None:
        self._kernel(self._bands, steps, step, self._states, self._sheet, self._scratch)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        super()._upload(position, velocity)
        self._place_ghosts(slice(None))

    def _place_ghosts(self, rows: slice) -> None:
        """Set the ghosts of rows that were written (core/layout.py)."""
        columns, stride = self._layout.columns, self._layout.stride
        spare = self._layout.view(self._flat, stride)[:, rows, columns:]
        spare[:2] = self.current[:2, rows, columns - 1 :]
        spare[2:] = 0
