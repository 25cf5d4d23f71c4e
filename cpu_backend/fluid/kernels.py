"""Kernels of a fluid on CPU threads: all substeps of a call by one team (`advance`), or a parallel loop per stage."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.fluid.constraint import make_iteration, make_search_phases, make_sides_of
from softlab.cpu_backend.fluid.flow import make_flow, make_flowing
from softlab.cpu_backend.fluid.phases import make_order
from softlab.cpu_backend.fluid.velocities import make_velocities
from softlab.model.base.types import Real
from softlab.model.fluid.plan import SHAPES


def _phases(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    order = make_order(compiler, real, parts)
    searches = make_search_phases(compiler, real, parts, order.cells_in)
    iteration = make_iteration(compiler, real, parts)
    velocities = make_velocities(compiler, real, parts, make_sides_of(compiler, real, parts))
    flow = make_flow(compiler, real, parts)
    return SimpleNamespace(**vars(order), **vars(searches), **vars(iteration), **vars(velocities), **vars(flow))


def fluid_compiler(name: str, real: Real, math: str, parts: frozenset[str]) -> Compiler:
    """Return the compiler of the kernels called `name`."""
    return Compiler(f"{name}_{np.dtype(real).name}_{math}_{'_'.join(sorted(parts))}", math)


@cache
def make_advance(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, substeps, iterations, everyone, parameters, fluids, integers, bodies, kinds,
    flow).

    It runs many steps in one call. `everyone` is the world with all particles; `flow` is that of
    cpu_backend/fluid/flow.py, if the scene has emitters or sinks.
    """
    compiler = fluid_compiler("fluid", real, math, parts)
    phases = _phases(compiler, real, parts)
    predict, enter, tally, put, prepare = phases.predict, phases.enter, phases.tally, phases.put, phases.prepare
    constrain, correct, update, finish = phases.constrain, phases.correct, phases.update, phases.finish
    shape, has_shape = phases.shape, bool(parts & SHAPES)
    emit, drain, rest, there_of, cells_in = phases.emit, phases.drain, phases.rest, phases.there_of, phases.cells_in
    emits, drains = "emitter" in parts, "sink" in parts

    def advance(
        team, member, bands, steps, step, substeps, iterations, everyone, parameters, fluids, integers, bodies, kinds, flow
    ):  # fmt: skip
        world = everyone
        for turn in range(steps * substeps):
            number, frame = step * substeps + turn, step + turn // substeps
            if emits:
                for part in assigned(team, member, bands):
                    if part == 0:
                        emit(number, world, parameters, flow)
            if emits or drains:
                world = there_of(everyone, flow)
            for part in assigned(team, member, bands):
                predict(part, bands, frame, number, world, parameters, fluids, integers, bodies, kinds)
            for part in assigned(team, member, bands):
                enter(part, bands, world, parameters)
            if drains:
                for part in assigned(team, member, bands):
                    drain(part, bands, world, flow)
            for part in assigned(team, member, bands):
                tally(part, bands, world, parameters)
            for part in assigned(team, member, bands):
                put(part, bands, world, parameters)
            if drains:
                for part in assigned(team, member, bands):
                    if part == 0:
                        rest(world, cells_in(bands, world, parameters)[2], flow)
                world = there_of(everyone, flow)
            for part in assigned(team, member, bands):
                prepare(part, bands, number, world, parameters, fluids, bodies, kinds)
            place, there = world.in_order.position, world.work.next
            for iteration in range(iterations):
                if iteration > 0:
                    for part in assigned(team, member, bands):
                        constrain(part, bands, number, place, world, parameters, bodies, kinds)
                for part in assigned(team, member, bands):
                    correct(part, bands, number, place, there, world, parameters, fluids, bodies, kinds)
                place, there = there, place
            for part in assigned(team, member, bands):
                update(part, bands, number, place, world, parameters, fluids, bodies, kinds)
            if has_shape:
                for part in assigned(team, member, bands):
                    shape(part, bands, place, world, parameters)
            for part in assigned(team, member, bands):
                finish(part, bands, place, world, parameters, fluids)

    return compiler.team(advance)


@cache
def make_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile each phase as a parallel loop (bands, ...).

    `sort` runs three phases by a team; with emitters or sinks `make_flowing` of cpu_backend/fluid/flow.py makes it.
    """
    compiler = fluid_compiler("fluid_stages", real, math, parts)
    phases = _phases(compiler, real, parts)
    names = ("predict", "find", "constrain", "correct", "update", "shape", "finish")
    loops = {name: compiler.banded(getattr(phases, name)) for name in names}
    if parts & {"emitter", "sink"}:
        return SimpleNamespace(**make_flowing(compiler, phases, "sink" in parts), **loops)
    return SimpleNamespace(sort=make_sort(compiler, phases), **loops)


def make_sort(compiler: Compiler, phases: SimpleNamespace) -> Callable:
    """Make sort(bands, world, parameters): three phases, by a team."""
    enter, tally, put = phases.enter, phases.tally, phases.put

    def sort(team, member, bands, world, parameters):
        for part in assigned(team, member, bands):
            enter(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            tally(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            put(part, bands, world, parameters)

    return compiler.team(sort)
