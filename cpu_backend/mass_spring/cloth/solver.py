"""The mass-spring cloth on CPU threads: `stages` (stage by stage over the whole sheet, the teaching version) and
`fused` (one pass over the sheet for each force). In `exact` math both give the same bits, for any number of threads."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from softlab.cpu_backend.core.layout import aligned_zeros, padded, plain
from softlab.cpu_backend.core.normals import make_normals
from softlab.cpu_backend.core.scratch import AXES, scratch_width, triples_of
from softlab.cpu_backend.core.simulation import RowsSimulation, chosen_kernel
from softlab.cpu_backend.mass_spring.arrays import Passes, Sheet
from softlab.cpu_backend.mass_spring.cloth.implicit import ImplicitSteps
from softlab.cpu_backend.mass_spring.cloth.kernels import PIN_ROWS, PLANES, make_cloth_advance
from softlab.cpu_backend.mass_spring.cloth.rk4 import make_cloth_rk4
from softlab.cpu_backend.mass_spring.cloth.stages import bind_cloth_stages
from softlab.cpu_backend.mass_spring.grid.row_step import CLOSING, MIDDLE, OPENING
from softlab.model.base.errors import SceneError
from softlab.model.contact.cloth_parameters import body_rows, pin_velocity
from softlab.model.core.integrators import IMPLICIT
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.mass_spring.cloth_plan import cloth_plan, kicks_coupled
from softlab.model.scene.scene import Scene


def choose_kernel(wanted: str | None, integrator: str = "") -> str:
    """Return the kernel `wanted`, or `fused`. Raises SceneError for any other."""
    if wanted == "stages" and integrator in IMPLICIT:
        raise SceneError("--kernel", wanted, f"must be fused for {integrator}, whose stages repeat until they are done")
    return chosen_kernel(wanted, "a cloth")


class ClothMassSpring(RowsSimulation):
    """The cloth on CPU threads; model/core/simulation.py defines the contract. `threads`: `1x`, `2x`, `4x` or a number.
    `implicit`: further arrays of implicit Euler, else None."""

    implicit: ImplicitSteps | None = None

    def __init__(self, scene: Scene, options: Options, threads: str | int = "1x"):
        super().__init__(scene, options, threads)
        self.kernel = choose_kernel(options.kernel, scene.method.integrator)
        self.plan = cloth_plan(scene, options.live)
        rows, columns = self.body.rows, self.body.columns
        self.integers = self._seeds(4)  # and where the rows of pins begin
        colliders, self.integers[PIN_ROWS] = body_rows(scene, self.body, self.real)
        self._set_colliders(colliders)
        make_layout = plain(rows, columns, PLANES), padded(rows, columns, self.real, PLANES)
        self._layout = make_layout[self.kernel != "stages"]
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
            return Executor(self.plan, bind_cloth_stages(self))
        scratch = AXES * triples_of(self.plan.parts)["count"] * scratch_width(self.body.columns, self.real)
        self._scratch = aligned_zeros(self._bands * scratch, self.real).reshape(self._bands, scratch)
        if self._is_rk4:
            self._kernel = make_cloth_rk4(self.real, self.options.math, self.plan.parts)
            return Executor(self.plan, {}, self._advance_rk4)
        integrator = self.scene.method.integrator
        if integrator in IMPLICIT:
            self.implicit = ImplicitSteps(self)
            return Executor(self.plan, {}, self.implicit.advance)
        self._kernel = make_cloth_advance(self.real, self.options.math, integrator, self.plan.parts)
        return Executor(self.plan, {}, self._advance_fused)

    @property
    def sheet(self) -> Sheet:
        return Sheet(
            self._integers_of_layout, self.parameters, self.integers, self._pin_start, self._pin_column, self.bodies,
            self.kinds,
        )  # fmt: skip

    def _passes(self, step: int, steps: int) -> tuple[Passes, np.ndarray, int, Sheet, np.ndarray]:
        """Return the arguments of the kernel `fused`: one pass per step; for velocity Verlet one more, or twice as
        many."""
        verlet = self.scene.method.integrator == "velocity-verlet"
        first, last = (OPENING, CLOSING) if verlet else (MIDDLE, MIDDLE)
        passes = 2 * steps if verlet and not kicks_coupled(self.plan.parts) else steps + verlet
        return Passes(passes, first, last, step), self._states, self._current, self.sheet, self._scratch

    def _advance_fused(self, step: int, steps: int) -> None:
        arguments = self._passes(step, steps)
        self._kernel(self._bands, *arguments)
        self._current = (self._current + arguments[0].number) % 2

    def _advance_rk4(self, step: int, steps: int) -> None:
        self._kernel(self._bands, steps, step, self._states, self.sheet, self._scratch)

    def _parameters_changed(self) -> None:
        super()._parameters_changed()
        if self.implicit is not None:
            self.implicit.renew()

    def _pin_velocity(self, step: int) -> np.ndarray | float:
        if "motion" not in self.plan.parts:
            return 0
        return pin_velocity(self.bodies, int(self.integers[PIN_ROWS]), len(self.body.pinned), step, self._record)

    def _read_normal(self, into: Any) -> Any:
        out = np.empty((self.body.rows * self.body.columns, AXES), self.real)
        numba.set_num_threads(self.threads)
        make_normals(self.real)(self.current, out)
        if into is None:
            return out
        into[...] = out
        return into
