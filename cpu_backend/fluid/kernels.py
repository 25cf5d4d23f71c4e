"""Kernels of a fluid on CPU threads: all substeps of a call by one team (`advance`), or a parallel loop per stage."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.fluid.constraint import constrain, correct, find, prepare
from softlab.cpu_backend.fluid.flow import drain, emit, emit_particles, rest, there_of
from softlab.cpu_backend.fluid.flow import sort as sort_active
from softlab.cpu_backend.fluid.phases import cells_in, enter, predict, put, tally
from softlab.cpu_backend.fluid.velocities import finish, shape, update
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Variant, routine
from softlab.model.fluid.parameters import MAX_NEIGHBOURS
from softlab.model.fluid.plan import FLOWS, fluid_features


@routine
def advance(
    team, member, bands, steps, step, substeps, iterations, everyone, parameters, fluids, integers, bodies, kinds, flow
):  # fmt: skip
    world = everyone
    for turn in range(steps * substeps):
        number, frame = step * substeps + turn, step + turn // substeps
        if FEATURE.emitter:
            for part in assigned(team, member, bands):
                if part == 0:
                    emit_particles(number, world, parameters, flow)
        if FEATURE.emitter or FEATURE.sink:
            world = there_of(everyone, flow)
        for part in assigned(team, member, bands):
            predict(part, bands, frame, number, world, parameters, fluids, integers, bodies, kinds)
        for part in assigned(team, member, bands):
            enter(part, bands, world, parameters)
        if FEATURE.sink:
            for part in assigned(team, member, bands):
                drain(part, bands, world, flow)
        for part in assigned(team, member, bands):
            tally(part, bands, world, parameters)
        for part in assigned(team, member, bands):
            put(part, bands, world, parameters)
        if FEATURE.sink:
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
        if FEATURE.shapes:
            for part in assigned(team, member, bands):
                shape(part, bands, place, world, parameters)
        for part in assigned(team, member, bands):
            finish(part, bands, place, world, parameters, fluids)


@routine
def sort(team, member, bands, world, parameters):
    """Run three phases, by a team."""
    for part in assigned(team, member, bands):
        enter(part, bands, world, parameters)
    for part in assigned(team, member, bands):
        tally(part, bands, world, parameters)
    for part in assigned(team, member, bands):
        put(part, bands, world, parameters)


def fluid_compiler(name: str, real: Real, math: str, parts: frozenset[str]) -> Compiler:
    """Return the compiler of the kernels called `name`."""
    return Compiler(f"{name}_{np.dtype(real).name}_{math}_{'_'.join(sorted(parts))}", math)


def fluid_variant(compiler: Compiler, real: Real, parts: frozenset[str]) -> Variant:
    """Return the variant of a fluid's kernels."""
    features = fluid_features(parts)
    return compiler.variant_of(real, features | {"neighbours": MAX_NEIGHBOURS[features["axes"]]})


@cache
def make_advance(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, substeps, iterations, everyone, parameters, fluids, integers, bodies, kinds,
    flow).

    It runs many steps in one call. `everyone` is the world with all particles; `flow` is that of
    cpu_backend/fluid/flow.py, if the scene has emitters or sinks.
    """
    compiler = fluid_compiler("fluid", real, math, parts)
    return compiler.team(fluid_variant(compiler, real, parts).copied(with_forces(advance, parts)))


@cache
def make_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile each phase as a parallel loop (bands, ...). `sort` runs its phases by a team, and with emitters or sinks
    `emit` too."""
    compiler = fluid_compiler("fluid_stages", real, math, parts)
    variant = fluid_variant(compiler, real, parts)
    loops = {"predict": predict, "find": find, "constrain": constrain, "correct": correct, "update": update}
    loops |= {"shape": shape, "finish": finish}
    teams = {"sort": sort_active, "emit": emit} if parts & FLOWS else {"sort": sort}
    return SimpleNamespace(
        **{name: compiler.banded(variant(with_forces(loop, parts))) for name, loop in loops.items()},
        **{name: compiler.team(variant.copied(team)) for name, team in teams.items()},
    )
