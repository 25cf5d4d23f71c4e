"""The hand-out's step as a plain gather on CPU threads, for bench/experiments/findings/determinism.py, not for users.
Each mass sums the forces of its four springs, so each spring is evaluated twice, once for either mass. The kernel
`fused` gathers too, but reuses a force for the next mass and the next row.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import PLANES, row_at
from softlab.cpu_backend.mass_spring.grid.rows import variant_name
from softlab.cpu_backend.mass_spring.grid.solver import MassSpring
from softlab.model.base.types import Real
from softlab.model.core.plan import Executor
from softlab.model.core.simulation import Options
from softlab.model.formulas import integrators, springs
from softlab.model.scene.scene import Scene

TWICE = "twice"  # the kernel's name


def _make_row(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Make the step of `count` masses of a row. Neighbours are separate arrays, so that the loop vectorises fully."""
    formulas = compiler.formulas(springs, real)
    spring_acceleration_2d, damped = formulas.spring_acceleration_2d, formulas.damped
    lab = compiler.formulas(integrators, real).lab
    has_gravity, has_damping = "gravity" in parts, "damping" in parts

    @compiler.row
    def gather_row(
        count, x, y, vx, vy, x_left, y_left, x_right, y_right, x_above, y_above, x_below, y_below, parameters, new_x, new_y,
        new_vx, new_vy,
    ):  # fmt: skip
        stiffness, rest = parameters.stiffness, parameters.stiffness_rest
        dt, half_dt_squared = parameters.dt, parameters.half_dt_squared
        for j in range(count):
            right_x, right_y = spring_acceleration_2d(x_right[j] - x[j], y_right[j] - y[j], stiffness, rest)
            left_x, left_y = spring_acceleration_2d(x_left[j] - x[j], y_left[j] - y[j], stiffness, rest)
            below_x, below_y = spring_acceleration_2d(x_below[j] - x[j], y_below[j] - y[j], stiffness, rest)
            above_x, above_y = spring_acceleration_2d(x_above[j] - x[j], y_above[j] - y[j], stiffness, rest)
            ax, ay = (right_x + left_x) + (below_x + above_x), (right_y + left_y) + (below_y + above_y)
            if has_gravity:
                ay = ay + parameters.gravity
            if has_damping:
                ax, ay = damped(ax, vx[j], parameters.damping), damped(ay, vy[j], parameters.damping)
            new_x[j], new_vx[j] = lab(x[j], vx[j], ax, dt, half_dt_squared)
            new_y[j], new_vy[j] = lab(y[j], vy[j], ay, dt, half_dt_squared)

    return gather_row


@cache
def make_gather(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make advance(steps, states, current, rows, columns, parameters, pin_start, pin_column).

    It does `steps` steps, alternating between the two states (4 planes of rows x columns each) in the flat array
    `states`.
    """
    compiler = Compiler(variant_name(TWICE, real, math, "lab", parts), math)
    gather_row = _make_row(compiler, real, parts)
    zero = real(0)

    @compiler.compiled
    def part_of_row(count, here, left, right, above, below, plane, source, target, parameters):
        """Step `count` masses from index `here` on. At the grid's edges a mass stands for its missing neighbour,
        because coincident masses exert no force.

        At the grid's edges a mass replaces its own missing neighbour, since coincident masses exert no force.
        """
        gather_row(
            count, row_at(source, here), row_at(source, here + plane), row_at(source, here + 2 * plane),
            row_at(source, here + 3 * plane), row_at(source, left), row_at(source, left + plane),
            row_at(source, right), row_at(source, right + plane), row_at(source, above), row_at(source, above + plane),
            row_at(source, below), row_at(source, below + plane), parameters, row_at(target, here),
            row_at(target, here + plane), row_at(target, here + 2 * plane), row_at(target, here + 3 * plane),
        )  # fmt: skip

    @compiler.compiled
    def step_row(i, rows, columns, plane, source, target, parameters, pin_start, pin_column):
        here, last = i * columns, columns - 1
        up, down = -columns if i > 0 else 0, columns if i < rows - 1 else 0
        first_right, last_here = here + min(1, last), here + last
        part_of_row(1, here, here, first_right, here + up, here + down, plane, source, target, parameters)
        if columns > 2:
            k = here + 1
            part_of_row(columns - 2, k, here, k + 1, k + up, k + down, plane, source, target, parameters)
        if last > 0:
            part_of_row(
                1, last_here, last_here - 1, last_here, last_here + up, last_here + down, plane, source, target, parameters
            )  # fmt: skip
        for k in range(pin_start[i], pin_start[i + 1]):
            j = here + pin_column[k]
            target[j] = source[j]
            target[j + plane] = source[j + plane]
            target[j + 2 * plane] = zero
            target[j + 3 * plane] = zero

    def advance(steps, states, current, rows, columns, record, pin_start, pin_column):
        plane = rows * columns
        for k in range(steps):
            here = (current + k) % 2
            source, target = row_at(states, here * PLANES * plane), row_at(states, (1 - here) * PLANES * plane)
            for i in prange(rows):
                step_row(np.int64(i), rows, columns, plane, source, target, record[0], pin_start, pin_column)

    return compiler.kernel(advance)


class GatherGrid(MassSpring):
    """Simulation (model/core/simulation.py) for scenes of the lab's grid (bench/peers/base.py: grid_refusal).

    `kernel_name`: the kernel's name; `make`: the function that makes it.
    """

    kernel_name, make = TWICE, staticmethod(make_gather)

    def __init__(self, scene: Scene, precision: str, math: str = "fast", threads: str | int = "1x"):
        super().__init__(scene, Options(precision, math, "stages"), threads)  # `stages`: rows without padding

    def _make_executor(self) -> Executor:
        self.kernel = self.kernel_name
        self._kernel = self.make(self.real, self.options.math, self.plan.parts)
        self._beside = self._arrays()
        return Executor(self.plan, {}, self._advance_steps)

    def _arrays(self) -> tuple[np.ndarray, ...]:
        """Return further arrays of the kernel."""
        return ()

    def _advance_steps(self, step: int, steps: int) -> None:
        body = self.body
        self._kernel(
            steps, self._states, self._current, body.rows, body.columns, self.record, self._pin_start, self._pin_column,
            *self._beside,
        )  # fmt: skip
        self._current = (self._current + steps) % 2
