"""The stages of the cloth's plan, one kernel each, run over the whole sheet: the teaching version.

One mass at a time sums the forces of its up to twelve neighbours and the wind on its up to six triangles
(mass_spring/cloth/stage_forces.py), as in mass_spring/grid/stages.py. Each stage has separate input and output arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.contact.collide_stage import make_collide_stage
from softlab.cpu_backend.contact.pins import follow
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import bind_forces
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.core.simulation import RowsSimulation
from softlab.cpu_backend.core.wind import make_wind_stage
from softlab.cpu_backend.mass_spring.cloth.kernels import PIN_ROWS
from softlab.cpu_backend.mass_spring.cloth.stage_forces import make_spring_stage
from softlab.cpu_backend.mass_spring.motion_stages import Planes, bind_motion, make_motion_stages
from softlab.model.base.types import Real
from softlab.model.base.variant import routine
from softlab.model.contact.cloth_parameters import (
    P_MOTION,
    PIN_FIELDS,
)
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.cloth import instant
from softlab.model.formulas.motion import middle
from softlab.model.tables.cloth import COLLIDER_KINDS, SPRING_KINDS


@routine
def pins(bodies, first, rows, columns, step, halfway, record, state):
    """Move the pinned masses that follow a motion, to the step's end or half-way through it. `first`: where the rows of
    pins begin in `bodies`; `rows`, `columns`: of the pinned masses."""
    x, y, z, vx, vy, vz = state
    clock = record[0].dt, record[0].first_step, record[0].first_time
    time = middle(step, *clock) if halfway else instant(step + 1, *clock)
    for k in prange(rows.size):
        pin = first + PIN_FIELDS * k
        if bodies[pin + P_MOTION] >= 0.0:
            i, j = rows[k], columns[k]
            x[i, j], y[i, j], z[i, j], vx[i, j], vy[i, j], vz[i, j] = follow(bodies, pin, time)


def make_pin_stage(compiler: Compiler, real: Real, parts: frozenset[str]) -> Callable:
    """Compile `pins`."""
    return compiler.kernel(compiler.variant_of(real).copied(pins))


@cache
def make_cloth_stages(real: Real, math: str, integrator: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make the stage kernels of a variant; each is compiled when it first runs, for the parts that affect it."""

    def build(make: Callable, words: Sequence[str]) -> Callable:
        matter = frozenset(part for part in parts if part.split("-")[0] in words)
        return make(Compiler(cloth_variant("stage", real, math, matter), math), real, matter)

    kicks = parts & {"damping"}
    compiler = Compiler(cloth_variant(f"stage_{integrator}", real, math, kicks), math)
    stages = make_motion_stages(compiler, real, integrator, "damping" in kicks)
    stages.spring_forces = build(make_spring_stage, SPRING_KINDS)
    stages.wind = build(make_wind_stage, ("wind", "gust"))
    stages.collide = build(make_collide_stage, (*COLLIDER_KINDS, "friction", "restitution"))
    stages.pins = build(make_pin_stage, ("motion",))
    return stages


def bind_cloth_stages(sim: RowsSimulation) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a cpu_backend.mass_spring.cloth.solver.ClothMassSpring."""
    integrator = sim.scene.method.integrator
    make = make_cloth_stages(sim.real, sim.options.math, integrator, sim.plan.parts)
    sums = np.zeros((3, sim.body.rows, sim.body.columns), sim.real)
    acceleration = tuple(sums)
    state = tuple(sim.current)
    before = tuple(sim.current[:3].copy()) if len(sim.kinds) else ()
    at: dict[str, Planes] = {"state": state}  # state at which forces are evaluated: the state, or a stage of RK4
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

    def store_positions() -> None:
        for stored, now in zip(before, state, strict=False):
            stored[...] = now

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

    bound = bind_forces(sim, sums) | bind_motion(sim, make, at, state, acceleration, store_positions)
    return bound | {
        "spring forces": lambda moment: make.spring_forces(at["state"], sim.record, acceleration),
        "no forces": no_forces,
        "wind": wind,
        "collide": collide,
        "pins": pins,
    }
