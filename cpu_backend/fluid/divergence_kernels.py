"""Kernels of the scheme `divergence-free` on CPU threads: all substeps of a call by one team (`advance`), or a parallel
loop per stage. cpu_backend/fluid/kernels.py has those of the other schemes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.fluid.constraint import find
from softlab.cpu_backend.fluid.divergence import foresee, move, push, relax, survey, take_up
from softlab.cpu_backend.fluid.divergence_pairs import accelerate, gather
from softlab.cpu_backend.fluid.kernels import fluid_compiler, fluid_variant, sort
from softlab.cpu_backend.fluid.phases import enter, put, tally
from softlab.cpu_backend.fluid.velocities import shape
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, routine
from softlab.model.core.plan import Moment, StageRun
from softlab.model.fluid.divergence_plan import SECOND


@routine
def advance(
    team, member, bands, steps, step, substeps, iterations, world, parameters, fluids, integers, bodies, kinds
):  # fmt: skip
    for turn in range(steps * substeps):
        number, frame = step * substeps + turn, step + turn // substeps
        for part in assigned(team, member, bands):
            gather(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            enter(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            tally(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            put(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            find(part, bands, number, world, parameters, fluids, bodies, kinds)
            survey(part, bands, number, world, parameters, bodies, kinds)
        for second in range(2):
            if second > 0:
                if FEATURE.shapes:
                    for part in assigned(team, member, bands):
                        shape(part, bands, world.in_order.position, world, parameters)
                for part in assigned(team, member, bands):
                    accelerate(part, bands, frame, world, parameters, fluids, integers)
                for part in assigned(team, member, bands):
                    foresee(part, bands, world, parameters)
            for k in range(iterations):
                for part in assigned(team, member, bands):
                    relax(part, bands, k, iterations, second > 0, world, parameters)
                for part in assigned(team, member, bands):
                    push(part, bands, k, world, parameters, fluids)
            if second == 0:
                for part in assigned(team, member, bands):
                    take_up(part, bands, world, parameters, fluids)
        for part in assigned(team, member, bands):
            move(part, bands, number, world, parameters, fluids, bodies, kinds)


@cache
def make_advance_freely(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, substeps, iterations, world, parameters, fluids, integers, bodies, kinds).

    It runs many steps in one call.
    """
    compiler = fluid_compiler("fluid_free", real, math, parts)
    return compiler.team(fluid_variant(compiler, real, parts).copied(with_forces(advance, parts)))


@cache
def make_free_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile each phase as a parallel loop (bands, ...); `sort` runs three phases by a team."""
    compiler = fluid_compiler("fluid_free_stages", real, math, parts)
    variant = fluid_variant(compiler, real, parts)
    loops = {"find": find} | {
        each.__name__: each for each in (gather, survey, foresee, relax, push, take_up, shape, accelerate, move)
    }
    return SimpleNamespace(
        sort=compiler.team(variant.copied(sort)),
        **{name: compiler.banded(variant(with_forces(loop, parts))) for name, loop in loops.items()},
    )


def free_stages(sim: Any) -> dict[str, StageRun]:
    """Return the function that runs each stage of the plan of `sim`, a cpu_backend.fluid.solver.Fluid."""
    stage, method = make_free_stages(sim.real, sim.options.math, sim.plan.parts), sim.scene.method
    world, bands = sim._world, sim._bands

    def run(kernel: Any, arguments: Callable[[Moment], tuple[Any, ...]]) -> StageRun:
        return lambda moment: kernel(bands, *arguments(moment))

    def touched() -> tuple[Any, ...]:
        return sim.bodies, sim.kinds

    return {
        "gather": run(stage.gather, lambda at: (world, sim.parameters)),
        "sort into cells": run(stage.sort, lambda at: (world, sim.parameters)),
        "find neighbours": run(stage.find, lambda at: (at.number, world, sim.parameters, sim._fluids, *touched())),
        "density and divergence": run(stage.survey, lambda at: (at.number, world, sim.parameters, *touched())),
        "relax": run(
            stage.relax, lambda at: (at.iteration, method.iterations, at.argument == SECOND, world, sim.parameters)
        ),
        "push apart": run(stage.push, lambda at: (at.iteration, world, sim.parameters, sim._fluids)),
        "take up": run(stage.take_up, lambda at: (world, sim.parameters, sim._fluids)),
        "normals and vorticity": run(stage.shape, lambda at: (world.in_order.position, world, sim.parameters)),
        "accelerate": run(stage.accelerate, lambda at: (at.step, world, sim.parameters, sim._fluids, sim.integers)),
        "foresee density": run(stage.foresee, lambda at: (world, sim.parameters)),
        "move": run(stage.move, lambda at: (at.number, world, sim.parameters, sim._fluids, *touched())),
    }
