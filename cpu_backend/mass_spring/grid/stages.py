"""The stages of the mass-spring plan, one kernel each, run over the whole grid: the teaching version.

One mass at a time gathers the pulls of its up to four neighbours; every row is an iteration of a parallel loop. Each
stage reads and writes memory of its own, which is what makes it slow, and easy to read, to time and to test against.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.core.compile import Compiler
from cpu_backend.core.force_stages import OF_GRID, bind_forces
from model.core.parameters import (
    K_AMPLITUDE,
    K_DAMPING,
    K_DT,
    K_FIRST_STEP,
    K_FIRST_TIME,
    K_GRAVITY,
    K_HALF_DT,
    K_HALF_DT_SQUARED,
    K_INERTIA,
    K_INVERSE_DAMPING,
    K_SIXTH_DT,
    K_SPACING,
    K_STIFF,
    K_STIFF_REST,
    K_STIFFNESS,
    K_STIFFNESS_REST,
    K_THIRD_DT,
)  # fmt: skip
from model.core.plan import Moment, StageRun
from model.formulas import integrators, manufactured, springs


@cache
def make_stages(real: Any, math: str, integrator: str, alternating: bool = False) -> SimpleNamespace:
    """The stage kernels of an arithmetic and integrator, for equal or for alternating springs. Arrays are (rows, columns);
    `a` is the acceleration (2, ...)."""
    compiler = Compiler("_".join(["stage", np.dtype(real).name, math, integrator.replace("-", "_")]), math)
    compiled, kernel = compiler.compiled, compiler.kernel
    spring_acceleration_2d, damped_formula = springs.make(real, compiled)
    manufactured_acceleration, stage_time = manufactured.make(real, compiled)
    formulas = integrators.make(real, compiled)
    first_half, second_half, rk4_stage = formulas.verlet_first_half, formulas.verlet_second_half, formulas.rk4_stage
    one_force = getattr(formulas, integrator.replace("-", "_"), formulas.semi_implicit_euler)

    @kernel
    def spring_forces(x, y, record, ax, ay):
        rows, columns = x.shape
        stiffness, stiffness_rest = record[K_STIFFNESS], record[K_STIFFNESS_REST]
        for row in prange(rows):
            i = np.int64(row)
            for j in range(columns):
                # a neighbour beyond the edge is replaced by the mass itself: coincident masses do not pull
                up, down, left, right = max(i - 1, 0), min(i + 1, rows - 1), max(j - 1, 0), min(j + 1, columns - 1)
                right_x, right_y = spring_acceleration_2d(
                    x[i, right] - x[i, j], y[i, right] - y[i, j], stiffness, stiffness_rest
                )
                left_x, left_y = spring_acceleration_2d(
                    x[i, left] - x[i, j], y[i, left] - y[i, j], stiffness, stiffness_rest
                )
                down_x, down_y = spring_acceleration_2d(
                    x[down, j] - x[i, j], y[down, j] - y[i, j], stiffness, stiffness_rest
                )
                up_x, up_y = spring_acceleration_2d(x[up, j] - x[i, j], y[up, j] - y[i, j], stiffness, stiffness_rest)
                ax[i, j] = (right_x + left_x) + (down_x + up_x)
                ay[i, j] = (right_y + left_y) + (down_y + up_y)

    @compiled
    def pull(x, y, i, j, row, column, lower, record):
        """The pull on mass (i, j) from (row, column), by a spring from row or column `lower` to the next."""
        odd = lower & 1
        stiffness = record[K_STIFF] if odd else record[K_STIFFNESS]
        rest = record[K_STIFF_REST] if odd else record[K_STIFFNESS_REST]
        return spring_acceleration_2d(x[row, column] - x[i, j], y[row, column] - y[i, j], stiffness, rest)

    @kernel
    def alternating_spring_forces(x, y, record, ax, ay):
        rows, columns = x.shape
        for row in prange(rows):
            i = np.int64(row)
            for j in range(columns):
                up, down, left, right = max(i - 1, 0), min(i + 1, rows - 1), max(j - 1, 0), min(j + 1, columns - 1)
                right_x, right_y = pull(x, y, i, j, i, right, j, record)
                left_x, left_y = pull(x, y, i, j, i, left, left, record)
                down_x, down_y = pull(x, y, i, j, down, j, i, record)
                up_x, up_y = pull(x, y, i, j, up, j, up, record)
                ax[i, j] = (right_x + left_x) + (down_x + up_x)
                ay[i, j] = (right_y + left_y) + (down_y + up_y)

    @kernel
    def manufactured_force(ax, ay, record, step, offset):
        rows, columns = ax.shape
        time = stage_time(step, offset, record[K_DT], record[K_FIRST_STEP], record[K_FIRST_TIME])
        for row in prange(rows):
            i = np.int64(row)
            for j in range(columns):
                fx, fy = manufactured_acceleration(
                    i, j, rows, columns, time, record[K_AMPLITUDE], record[K_INERTIA], record[K_SPACING],
                    record[K_STIFFNESS], record[K_STIFFNESS_REST], record[K_GRAVITY], record[K_DAMPING],
                )  # fmt: skip
                ax[i, j] += fx
                ay[i, j] += fy

    @kernel
    def damping(vx, vy, record, ax, ay):
        for i in prange(ax.shape[0]):
            for j in range(ax.shape[1]):
                ax[i, j] = damped_formula(ax[i, j], vx[i, j], record[K_DAMPING])
                ay[i, j] = damped_formula(ay[i, j], vy[i, j], record[K_DAMPING])

    @kernel
    def integrate(position, velocity, acceleration, record):
        for i in prange(position.shape[0]):
            for j in range(position.shape[1]):
                p, v = one_force(
                    position[i, j], velocity[i, j], acceleration[i, j], record[K_DT], record[K_HALF_DT_SQUARED]
                )
                position[i, j] = p
                velocity[i, j] = v

    @kernel
    def first_kick(position, velocity, acceleration, record):
        for i in prange(position.shape[0]):
            for j in range(position.shape[1]):
                p, v = first_half(
                    position[i, j],
                    velocity[i, j],
                    acceleration[i, j],
                    record[K_DT],
                    record[K_HALF_DT],
                    record[K_DAMPING],
                )
                position[i, j] = p
                velocity[i, j] = v

    @kernel
    def second_kick(velocity, acceleration, record):
        for i in prange(velocity.shape[0]):
            for j in range(velocity.shape[1]):
                velocity[i, j] = second_half(
                    velocity[i, j], acceleration[i, j], record[K_HALF_DT], record[K_INVERSE_DAMPING]
                )

    @kernel
    def accumulate(stage, base, source, acceleration, total, record, out):
        """One stage of RK4 on (4, rows, columns) states; the fourth writes the new state to `out`."""
        derivative_dt = record[K_DT] if stage == 3 else record[K_HALF_DT]
        total_dt = record[K_SIXTH_DT] if stage == 1 or stage == 4 else record[K_THIRD_DT]
        for i in prange(base.shape[1]):
            for j in range(base.shape[2]):
                for axis in range(4):
                    rate = source[2 + axis, i, j] if axis < 2 else acceleration[axis - 2, i, j]
                    before = base[axis, i, j] if stage == 1 else total[axis, i, j]
                    value, summed = rk4_stage(base[axis, i, j], rate, before, derivative_dt, total_dt)
                    total[axis, i, j] = summed
                    out[axis, i, j] = summed if stage == 4 else value

    return SimpleNamespace(
        spring_forces=alternating_spring_forces if alternating else spring_forces, manufactured=manufactured_force,
        damping=damping, integrate=integrate, first_kick=first_kick, second_kick=second_kick, accumulate=accumulate,
    )  # fmt: skip


def bind_stages(sim: Any) -> dict[str, StageRun]:
    """What runs each named stage of `sim`, a cpu_backend.mass_spring.grid.solver.MassSpring."""
    alternating = "alternating" in sim.plan.parts
    make = make_stages(sim.real, sim.options.math, sim.scene.method.integrator, alternating)
    shape = (2, sim.body.rows, sim.body.columns)
    acceleration = np.zeros(shape, sim.real)
    state = sim.current
    stages = {"at": state}  # where the forces are evaluated: the state, or a stage of RK4
    rk4 = sim.scene.method.integrator == "rk4"
    total, stage_state = (np.zeros_like(state) for _ in range(2)) if rk4 else (None, None)

    def here() -> np.ndarray:
        return stages["at"]

    def spring_forces(moment: Moment) -> None:
        make.spring_forces(here()[0], here()[1], sim.record, acceleration[0], acceleration[1])

    def no_forces(moment: Moment) -> None:
        acceleration[:] = 0

    def damping(moment: Moment) -> None:
        make.damping(here()[2], here()[3], sim.record, acceleration[0], acceleration[1])

    def manufactured_force(moment: Moment) -> None:
        make.manufactured(acceleration[0], acceleration[1], sim.record, moment.step, sim.real(moment.argument))

    def integrate(moment: Moment) -> None:
        for axis in range(2):
            make.integrate(state[axis], state[2 + axis], acceleration[axis], sim.record)

    def first_kick(moment: Moment) -> None:
        for axis in range(2):
            make.first_kick(state[axis], state[2 + axis], acceleration[axis], sim.record)

    def second_kick(moment: Moment) -> None:
        for axis in range(2):
            make.second_kick(state[2 + axis], acceleration[axis], sim.record)

    def accumulate(stage: int) -> StageRun:
        def run(moment: Moment) -> None:
            out = state if stage == 4 else stage_state
            make.accumulate(stage, state, here(), acceleration, total, sim.record, out)
            stages["at"] = out

        return run

    pin_rows, pin_columns = np.divmod(sim.body.pinned, shape[2])

    def pins(moment: Moment) -> None:
        here()[:2, pin_rows, pin_columns] = sim.pinned_position
        here()[2:, pin_rows, pin_columns] = 0

    return bind_forces(sim, acceleration, OF_GRID) | {
        "spring forces": spring_forces,
        "no forces": no_forces,
        "manufactured force": manufactured_force,
        "damping": damping,
        f"integrate ({sim.scene.method.integrator})": integrate,
        "first half kick and drift": first_kick,
        "second half kick": second_kick,
        **{f"accumulate (rk4 {stage})": accumulate(stage) for stage in range(1, 5)},
        "pins": pins,
    }
