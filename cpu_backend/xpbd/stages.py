"""The stages of a position-based plan, one kernel each, run over the whole sheet: the teaching version.

xpbd/stage_projections.py projects constraints; wind and colliders are the cloth's. Each stage has separate input and
output arrays, with a weight for every mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.contact.collide_stage import make_collide_stage
from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import bind_forces
from softlab.cpu_backend.core.point_stages import make_point_stages
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.core.wind import make_wind_stage
from softlab.cpu_backend.xpbd.stage_projections import bind_projections, make_projections
from softlab.model.base.types import Real
from softlab.model.core.plan import Moment, StageRun
from softlab.model.position_based.plan import FAMILIES
from softlab.model.tables.cloth import COLLIDER_KINDS


@cache
def make_position_stages(real: Real, math: str, axes: int, parts: frozenset[str]) -> SimpleNamespace:
    """Make the stage kernels of a variant; each is compiled when it first runs, for the parts that affect it."""

    def build(make: Callable, words: Sequence[str]) -> Any:
        matter = frozenset(part for part in parts if part.split("-")[0] in words)
        return make(Compiler(cloth_variant("xpbd_stage", real, math, matter), math), real, matter)

    stages = build(make_point_stages, ("load", "damping"))
    stages.wind = build(make_wind_stage, ("wind", "gust"))
    stages.collide = build(make_collide_stage, (*COLLIDER_KINDS, "friction", "restitution"))
    stages.projections = make_projections(real, math, axes, parts)
    return stages


def bind_position_stages(sim: Any) -> dict[str, StageRun]:
    """Return the function of each named stage of `sim`, a cpu_backend.xpbd.solver.PositionBased."""
    axes, parts = sim.scene.dimensions, sim.plan.parts
    make = make_position_stages(sim.real, sim.options.math, axes, parts)
    tables, shape = sim.tables, (axes, sim.body.rows, sim.body.columns)
    weights = tables.weights[tables.weight_row]
    position, velocity = sim.current[:axes], sim.current[axes:]
    before, acceleration, force = (np.zeros(shape, sim.real) for _ in range(3))
    multipliers = np.zeros((len(FAMILIES), *shape[1:]), sim.real)

    def wind(moment: Moment) -> None:
        into = force if "load" in parts else acceleration
        force[...] = 0
        make.wind(tuple(sim.current), sim.record, sim.integers, moment.number, sim.real(0), tuple(into))
        if "load" in parts:
            make.add_weighed(acceleration, weights, force)

    def predict(moment: Moment) -> None:
        make.predict(position, velocity, before, acceleration, weights, sim.record)
        acceleration[...] = 0
        multipliers[...] = 0

    def collide(moment: Moment) -> None:
        make.collide(sim.bodies, sim.kinds, moment.number, sim.record, tuple(before), tuple(sim.current))
        for axis in range(axes):
            position[axis][weights == 0] = before[axis][weights == 0]
            velocity[axis][weights == 0] = 0

    forces = bind_forces(sim, acceleration, weights=weights if "load" in parts else None)
    return forces | {
        "wind": wind,
        "predict": predict,
        "find contacts": lambda moment: sim.contacts.find(before, position),
        "project contacts": lambda moment: sim.contacts.project(position),
        **bind_projections(sim, make.projections, position, before, multipliers, weights),
        "update velocity": lambda moment: make.update_velocity(
            position, velocity, before, weights, sim.record
        ),
        "collide": collide,
    }  # fmt: skip
