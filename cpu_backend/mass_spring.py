"""The mass-spring grid on CPU threads.

Two kernels: `fused` (many steps in one call, see mass_spring_kernels.py) and `stages` (stage by stage over the whole
grid, see mass_spring_stages.py). In `exact` math both give the same bits, for any number of threads.
"""

from __future__ import annotations

import platform
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import prange

from cpu_backend.compile import Compiler
from cpu_backend.mass_spring_kernels import CLOSING, MIDDLE, OPENING, make_advance
from cpu_backend.mass_spring_stages import bind_stages
from cpu_backend.rk4_kernels import make_advance_rk4
from cpu_backend.rows import SCRATCH_PADDING, SCRATCH_ROWS
from cpu_backend.threads import thread_count
from model.errors import SceneError
from model.plan import Executor, mass_spring_plan
from model.scene import Scene
from model.simulation import Options, Simulation

KERNELS = ("fused", "stages")


@cache
def processor_name() -> str:
    """The processor as it calls itself."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


@cache
def _make_first_bad(real: Any) -> Any:
    """first_bad(state, bound, columns_bad): per row the first bad column, or -1. No fast math: NaN must be seen."""
    compiler = Compiler(f"{np.dtype(real).name}", "exact")

    def first_bad(state, bound, bad):
        zero = bound - bound
        for i in prange(state.shape[1]):
            bad[i] = -1
            for j in range(state.shape[2]):
                inside = abs(state[0, i, j]) <= bound and abs(state[1, i, j]) <= bound  # false for NaN
                still = state[2, i, j] - state[2, i, j] == zero and state[3, i, j] - state[3, i, j] == zero
                if not (inside and still):
                    bad[i] = j
                    break

    return compiler.kernel(first_bad)


class MassSpring(Simulation):
    """See model/simulation.py for the contract. `threads`: `1x`, `2x`, `4x` or a number."""

    backend = "cpu"

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options)
        self.threads = thread_count(threads)
        self.device = processor_name()
        self.kernel = options.kernel or "fused"
        if self.kernel not in KERNELS:
            raise SceneError("--kernel", options.kernel, f"must be one of {', '.join(KERNELS)} on the cpu")
        self.plan = mass_spring_plan(scene, options.live)
        rows, columns = self.body.rows, self.body.columns
        self.record = self._record
        self.integers = np.zeros(2, np.uint64)  # seed of the external force; 1 + poked particle, 0 for none
        self.integers[0] = scene.external.seed if scene.external else 0
        self.states = np.zeros((4 if self._is_rk4 else 2, 4, rows, columns), self.real)  # x, y, vx, vy of each
        self._current = 0
        self._kept = np.zeros((4, rows, columns), self.real)
        pin_row, pin_column = np.divmod(self.body.pinned, columns)
        self._pin_start = np.searchsorted(pin_row, np.arange(rows + 1)).astype(np.int64)
        self._pin_column = pin_column.astype(np.int64)
        self._pin_row = pin_row
        self._bad = np.full(rows, -1, np.int64)
        self._first_bad_kernel = _make_first_bad(self.real)
        bands = min(self.threads, rows)
        self._scratch = np.zeros((bands, SCRATCH_ROWS, columns + 1 + SCRATCH_PADDING), self.real)
        if self.kernel == "stages":
            self._executor = Executor(self.plan, bind_stages(self))
        elif self._is_rk4:
            self._kernel = make_advance_rk4(self.real, options.math, self.plan.parts)
            self._executor = Executor(self.plan, {}, self._advance_rk4)
        else:
            self._kernel = make_advance(self.real, options.math, scene.method.integrator, self.plan.parts)
            self._executor = Executor(self.plan, {}, self._advance_passes)
        self.reset()

    @property
    def _is_rk4(self) -> bool:
        return self.scene.method.integrator == "rk4"

    @property
    def current(self) -> np.ndarray:
        """(4, rows, columns): x, y, vx, vy now."""
        return self.states[self._current]

    def _run(self, steps: int) -> None:
        numba.set_num_threads(self.threads)
        self._executor.run(self.step, steps)

    def _advance_passes(self, step: int, steps: int) -> None:
        verlet = self.scene.method.integrator == "velocity-verlet"
        passes = steps + 1 if verlet else steps
        first, last = (OPENING, CLOSING) if verlet else (MIDDLE, MIDDLE)
        self._kernel(
            passes, first, last, step, self.states, self._current, self.record, self.integers, self._pin_start,
            self._pin_column, self._scratch,
        )  # fmt: skip
        self._current = (self._current + passes) % 2

    def _advance_rk4(self, step: int, steps: int) -> None:
        self._kernel(
            steps, step, self.states, self.record, self.integers, self._pin_start, self._pin_column, self._scratch
        )

    def _keep(self) -> None:
        self._kept[...] = self.current

    def _restore(self) -> None:
        self.current[...] = self._kept

    def _first_bad(self) -> int:
        numba.set_num_threads(self.threads)
        self._first_bad_kernel(self.current, self.real(self._bound), self._bad)
        rows = np.flatnonzero(self._bad >= 0)
        return int(rows[0] * self.body.columns + self._bad[rows[0]]) if len(rows) else -1

    def _parameters_changed(self) -> None:
        self.record = self._record
        self.integers[1] = self._poke_particle + 1

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        flat = self.current.reshape(4, -1)
        return np.ascontiguousarray(flat[:2].T), np.ascontiguousarray(flat[2:].T)

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.current[:2] = position.T.reshape(self.current[:2].shape)
        self.current[2:] = velocity.T.reshape(self.current[2:].shape)

    @property
    def pinned_position(self) -> np.ndarray:
        """(2, pins): where the pinned masses are held. They never move, so any state tells."""
        return self._kept[:2, self._pin_row, self._pin_column]

    def _read_position(self, into: Any) -> Any:
        if into is None:
            return self._download()[0]
        into[...] = self.current[:2].reshape(2, -1).T
        return into

    def synchronize(self) -> None:
        """Nothing to wait for: a call returns when its steps are done."""
