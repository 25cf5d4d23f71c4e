"""The stages that move masses, for the teaching versions of grids and cloths: damping and the integrators, one unknown
of all masses at a time, an array (rows, columns)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.simulation import RowsSimulation
from softlab.model.base.types import Real
from softlab.model.base.variant import filled, routine
from softlab.model.core.integrators import step_formula
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.integrators import one_force, rk4_stage, verlet_first_half, verlet_second_half
from softlab.model.formulas.springs import damped

Planes = Sequence[np.ndarray] | np.ndarray  # one array (rows, columns) per unknown


@routine
def damping(velocity, record, acceleration):
    for i in prange(velocity.shape[0]):
        for j in range(velocity.shape[1]):
            acceleration[i, j] = damped(acceleration[i, j], velocity[i, j], record[0].damping)


@routine
def integrate(position, velocity, acceleration, record):
    for i in prange(position.shape[0]):
        for j in range(position.shape[1]):
            p, v = one_force(
                position[i, j], velocity[i, j], acceleration[i, j], record[0].dt, record[0].half_dt_squared
            )
            position[i, j] = p
            velocity[i, j] = v


@routine
def first_kick(position, velocity, acceleration, record):
    for i in prange(position.shape[0]):
        for j in range(position.shape[1]):
            p, v = verlet_first_half(
                position[i, j], velocity[i, j], acceleration[i, j], record[0].dt, record[0].half_dt,
                record[0].damping,
            )  # fmt: skip
            position[i, j] = p
            velocity[i, j] = v


@routine
def second_kick(velocity, acceleration, record):
    for i in prange(velocity.shape[0]):
        for j in range(velocity.shape[1]):
            velocity[i, j] = verlet_second_half(
                velocity[i, j], acceleration[i, j], record[0].half_dt, record[0].inverse_damping
            )


@routine
def accumulate(stage, base, rate, total, record, out):
    """Do one stage of RK4 for one unknown of every mass; the fourth writes the new state to `out`."""
    derivative_dt = record[0].dt if stage == 3 else record[0].half_dt
    total_dt = record[0].sixth_dt if stage == 1 or stage == 4 else record[0].third_dt
    for i in prange(base.shape[0]):
        for j in range(base.shape[1]):
            before = base[i, j] if stage == 1 else total[i, j]
            value, summed = rk4_stage(base[i, j], rate[i, j], before, derivative_dt, total_dt)
            total[i, j] = summed
            out[i, j] = summed if stage == 4 else value


def make_motion_stages(compiler: Compiler, real: Real, integrator: str, has_damping: bool = True) -> SimpleNamespace:
    """Compile the kernels of damping and of an integrator."""
    variant = compiler.variant_of(real, {"damped": has_damping})
    kernels = damping, filled(integrate, {"one_force": step_formula(integrator)}), first_kick, second_kick, accumulate
    return SimpleNamespace(**{kernel.__name__: compiler.kernel(variant.copied(kernel)) for kernel in kernels})


def bind_motion(
    sim: RowsSimulation, make: SimpleNamespace, at: dict[str, Planes], state: Planes, acceleration: Planes,
    store: Callable[[], None],
) -> dict[str, StageRun]:  # fmt: skip
    """Return the functions of these stages of `sim`.

    `state`: one array per unknown, positions first; `at["state"]`: the state at which forces are evaluated, that or a
    stage of RK4; `store` is called before positions become those of a step's end.
    """
    integrator, axes = sim.scene.method.integrator, len(acceleration)
    empty = np.zeros((2 if integrator == "rk4" else 0, *sim.current.shape), sim.real)
    total, stage_state = (tuple(array) for array in empty) if len(empty) else ((), ())

    def each_axis(stage: Callable) -> StageRun:
        def run(moment: Moment) -> None:
            store()
            for axis in range(axes):
                stage(state[axis], state[axes + axis], acceleration[axis], sim.record)

        return run

    def damping(moment: Moment) -> None:
        for axis in range(axes):
            make.damping(at["state"][axes + axis], sim.record, acceleration[axis])

    def second_kick(moment: Moment) -> None:
        for axis in range(axes):
            make.second_kick(state[axes + axis], acceleration[axis], sim.record)

    def accumulate(stage: int) -> StageRun:
        def run(moment: Moment) -> None:
            here, out = at["state"], state if stage == 4 else stage_state
            rates = (*here[axes:], *acceleration)
            if stage == 4:
                store()
            for unknown in range(2 * axes):  # velocities last: those of the stage before are the rates of the positions
                make.accumulate(stage, state[unknown], rates[unknown], total[unknown], sim.record, out[unknown])
            at["state"] = out

        return run

    return {
        "damping": damping,
        f"integrate ({integrator})": each_axis(make.integrate),
        "first half kick and drift": each_axis(make.first_kick),
        "second half kick": second_kick,
        **{f"accumulate (rk4 {stage})": accumulate(stage) for stage in range(1, 5)},
    }
