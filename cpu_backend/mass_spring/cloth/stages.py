"""The stages of the cloth's plan, one kernel each, run over the whole sheet: the teaching version.

One mass at a time gathers the pulls of its up to twelve neighbours and the wind on its up to six triangles
(mass_spring/cloth/stage_forces.py), as mass_spring/grid/stages.py does for the grid; each stage reads and writes memory of
its own.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from cpu_backend.contact.colliders import make_collide_mass
from cpu_backend.contact.pins import make_follow
from cpu_backend.core.compile import Compiler
from cpu_backend.core.force_stages import bind_forces
from cpu_backend.mass_spring.cloth.kernels import PIN_ROWS
from cpu_backend.mass_spring.cloth.scratch import cloth_variant
from cpu_backend.mass_spring.cloth.stage_forces import make_spring_stage, make_wind_stage
from model.core.plan import Moment, StageRun
from model.formulas import cloth, integrators, motion, springs
from model.mass_spring.cloth_parameters import (
    C_DAMPING,
    C_DT,
    C_FIRST_STEP,
    C_FIRST_TIME,
    C_HALF_DT,
    C_HALF_DT_SQUARED,
    C_INVERSE_DAMPING,
    C_SIXTH_DT,
    C_THIRD_DT,
    P_MOTION,
    PIN_FIELDS,
)  # fmt: skip
from model.scene.cloth import COLLIDER_KINDS, SPRING_KINDS


def make_point_stages(compiler: Compiler, real: Any, integrator: str, has_damping: bool) -> SimpleNamespace:
    """The stages that look at no neighbour: one array (rows, columns) at a time."""
    compiled, kernel = compiler.compiled, compiler.kernel
    _, damped = springs.make(real, compiled)
    formulas = integrators.make(real, compiled, has_damping)
    first_half, second_half, rk4_stage = formulas.verlet_first_half, formulas.verlet_second_half, formulas.rk4_stage
    one_force = getattr(formulas, integrator.replace("-", "_"), formulas.semi_implicit_euler)

    @kernel
    def damping(velocity, record, acceleration):
        for i in prange(velocity.shape[0]):
            for j in range(velocity.shape[1]):
                acceleration[i, j] = damped(acceleration[i, j], velocity[i, j], record[C_DAMPING])

    @kernel
    def integrate(position, velocity, acceleration, record):
        for i in prange(position.shape[0]):
            for j in range(position.shape[1]):
                p, v = one_force(
                    position[i, j], velocity[i, j], acceleration[i, j], record[C_DT], record[C_HALF_DT_SQUARED]
                )
                position[i, j] = p
                velocity[i, j] = v

    @kernel
    def first_kick(position, velocity, acceleration, record):
        for i in prange(position.shape[0]):
            for j in range(position.shape[1]):
                p, v = first_half(
                    position[i, j], velocity[i, j], acceleration[i, j], record[C_DT], record[C_HALF_DT],
                    record[C_DAMPING],
                )  # fmt: skip
                position[i, j] = p
                velocity[i, j] = v

    @kernel
    def second_kick(velocity, acceleration, record):
        for i in prange(velocity.shape[0]):
            for j in range(velocity.shape[1]):
                velocity[i, j] = second_half(
                    velocity[i, j], acceleration[i, j], record[C_HALF_DT], record[C_INVERSE_DAMPING]
                )

    @kernel
    def accumulate(stage, base, rate, total, record, out):
        """One stage of RK4 for one unknown of every mass; the fourth writes the new state to `out`."""
        derivative_dt = record[C_DT] if stage == 3 else record[C_HALF_DT]
        total_dt = record[C_SIXTH_DT] if stage == 1 or stage == 4 else record[C_THIRD_DT]
        for i in prange(base.shape[0]):
            for j in range(base.shape[1]):
                before = base[i, j] if stage == 1 else total[i, j]
                value, summed = rk4_stage(base[i, j], rate[i, j], before, derivative_dt, total_dt)
                total[i, j] = summed
                out[i, j] = summed if stage == 4 else value

    return SimpleNamespace(
        damping=damping, integrate=integrate, first_kick=first_kick,
        second_kick=second_kick, accumulate=accumulate,
    )  # fmt: skip


def make_collide_stage(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """collide(bodies, kinds, step, record, before, state): the masses at the step's end, `before` where they began it."""
    collide_mass = make_collide_mass(compiler, real, parts)

    def collide(bodies, kinds, step, record, before, state):
        rows, columns = before[0].shape
        ax, ay, az = before
        x, y, z, vx, vy, vz = state
        for i in prange(rows):
            for j in range(columns):
                x[i, j], y[i, j], z[i, j], vx[i, j], vy[i, j], vz[i, j] = collide_mass(
                    bodies, kinds, step, record, ax[i, j], ay[i, j], az[i, j], x[i, j], y[i, j], z[i, j], vx[i, j],
                    vy[i, j], vz[i, j],
                )  # fmt: skip

    return compiler.kernel(collide)


def make_pin_stage(compiler: Compiler, real: Any, parts: frozenset[str]) -> Any:
    """pins(bodies, first, rows, columns, step, half_way, record, state): those that follow a motion, at the step's end or
    half-way through it. `first`: where the rows of pins begin in `bodies`; `rows`, `columns`: of the pinned masses."""
    follow = make_follow(compiler, real)
    instant, middle = cloth.make(real, compiler.compiled).instant, motion.make(real, compiler.compiled).middle
    zero = real(0)

    def pins(bodies, first, rows, columns, step, half_way, record, state):
        x, y, z, vx, vy, vz = state
        clock = record[C_DT], record[C_FIRST_STEP], record[C_FIRST_TIME]
        time = middle(step, *clock) if half_way else instant(step + 1, *clock)
        for k in prange(rows.size):
            pin = first + PIN_FIELDS * k
            if bodies[pin + P_MOTION] >= zero:
                i, j = rows[k], columns[k]
                x[i, j], y[i, j], z[i, j], vx[i, j], vy[i, j], vz[i, j] = follow(bodies, pin, time)

    return compiler.kernel(pins)


@cache
def make_cloth_stages(real: Any, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """The stage kernels of a variant; each is compiled when it first runs, and knows the parts that matter to it."""

    def made(make: Any, *words: str) -> Any:
        matter = frozenset(part for part in parts if part.split("-")[0] in words)
        return make(Compiler(cloth_variant("stage", real, math, matter), math), real, matter)

    kicks = parts & {"damping"}
    compiler = Compiler(cloth_variant(f"stage_{integrator}", real, math, kicks), math)
    stages = make_point_stages(compiler, real, integrator, "damping" in kicks)
    stages.spring_forces = made(make_spring_stage, *SPRING_KINDS)
    stages.wind = made(make_wind_stage, "wind", "gust")
    stages.collide = made(make_collide_stage, *COLLIDER_KINDS, "friction", "restitution")
    stages.pins = made(make_pin_stage, "motion")
    return stages


def bind_cloth_stages(sim: Any) -> dict[str, StageRun]:
    """What runs each named stage of `sim`, a cpu_backend.mass_spring.cloth.solver.ClothMassSpring."""
    integrator = sim.scene.method.integrator
    make = make_cloth_stages(sim.real, sim.options.math, integrator, sim.plan.parts)
    sums = np.zeros((3, sim.body.rows, sim.body.columns), sim.real)
    acceleration = tuple(sums)
    state = tuple(sim.current)
    empty = np.zeros((2 if integrator == "rk4" else 0, *sim.current.shape), sim.real)
    total, stage_state = (tuple(array) for array in empty) if len(empty) else ((), ())
    before = tuple(sim.current[:3].copy()) if len(sim.kinds) else ()
    at = {"state": state}  # where the forces are evaluated: the state, or a stage of RK4
    pin_rows, pin_columns = np.divmod(sim.body.pinned, sim.body.columns)
    whole_step = 1 if integrator == "velocity-verlet" else 0  # a step's end is the next one's start, to the last bit

    def no_forces(moment: Moment) -> None:
        for axis in range(3):
            acceleration[axis][...] = 0

    def wind(moment: Moment) -> None:
        now = moment.step + int(moment.argument) if whole_step else moment.step
        make.wind(
            at["state"], sim.record, sim.integers, now, sim.real(0 if whole_step else moment.argument), acceleration
        )

    def keep_positions() -> None:
        for kept, now in zip(before, state, strict=False):
            kept[...] = now

    def each_axis(stage: Any) -> StageRun:
        def run(moment: Moment) -> None:
            keep_positions()
            for axis in range(3):
                stage(state[axis], state[3 + axis], acceleration[axis], sim.record)

        return run

    def damping(moment: Moment) -> None:
        for axis in range(3):
            make.damping(at["state"][3 + axis], sim.record, acceleration[axis])

    def second_kick(moment: Moment) -> None:
        for axis in range(3):
            make.second_kick(state[3 + axis], acceleration[axis], sim.record)

    def accumulate(stage: int) -> StageRun:
        def run(moment: Moment) -> None:
            here, out = at["state"], state if stage == 4 else stage_state
            rates = tuple(here[3:]) + acceleration
            if stage == 4:
                keep_positions()
            for unknown in range(6):  # velocities last: those of the stage before are the rates of the positions
                make.accumulate(stage, state[unknown], rates[unknown], total[unknown], sim.record, out[unknown])
            at["state"] = out

        return run

    def collide(moment: Moment) -> None:
        make.collide(sim.bodies, sim.kinds, moment.step, sim.record, before, at["state"])

    def pins(moment: Moment) -> None:
        for axis in range(3):
            at["state"][axis][pin_rows, pin_columns] = sim.pinned_position[axis]
            at["state"][3 + axis][pin_rows, pin_columns] = 0
        if "motion" in sim.plan.parts:
            first = np.int64(sim.integers[PIN_ROWS])
            make.pins(
                sim.bodies, first, pin_rows, pin_columns, moment.step, moment.argument < 1, sim.record, at["state"]
            )

    return bind_forces(sim, sums) | {
        "spring forces": lambda moment: make.spring_forces(at["state"], sim.record, acceleration),
        "no forces": no_forces,
        "wind": wind,
        "damping": damping,
        f"integrate ({integrator})": each_axis(make.integrate),
        "first half kick and drift": each_axis(make.first_kick),
        "second half kick": second_kick,
        **{f"accumulate (rk4 {stage})": accumulate(stage) for stage in range(1, 5)},
        "collide": collide,
        "pins": pins,
    }
