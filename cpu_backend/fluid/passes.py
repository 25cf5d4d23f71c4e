"""Kernels of a fluid on CPU threads, made of phases in the order of the passes that model/fluid declares: all substeps of
a call by one team (`make_advance`), or one kernel per pass (`make_pass`).

A phase (part, bands, at, world) does a band of particles; the next one begins when all bands are done.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.own_forces import with_forces
from softlab.cpu_backend.core.progress import assigned
from softlab.cpu_backend.fluid import divergence, solid_phases
from softlab.cpu_backend.fluid.arrays import At, Fluid, Sizes
from softlab.cpu_backend.fluid.constraint import constrain, correct, find, prepare, search
from softlab.cpu_backend.fluid.divergence_pairs import accelerate, gather
from softlab.cpu_backend.fluid.flow import drain, emit, rest
from softlab.cpu_backend.fluid.phases import enter, predict, put, tally
from softlab.cpu_backend.fluid.velocities import finish, shape, update
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, open_constant, routine
from softlab.model.fluid.divergence_plan import SECOND
from softlab.model.fluid.parameters import MAX_NEIGHBOURS
from softlab.model.fluid.passes import (
    ACCELERATE,
    CORRECT,
    DENSITY,
    EMIT,
    FIND,
    FOLLOW,
    FORESEE,
    GATHER,
    LIMIT,
    MOVE,
    PREDICT,
    PUSH,
    PUSH_APART,
    RELAX,
    SAMPLE,
    SHAPE,
    SORT,
    SURVEY,
    TAKE_UP,
    UPDATE,
    Iterations,
    Pass,
    runs_of,
)
from softlab.model.fluid.plan import fluid_features, substep_of

Passes = tuple[str, ...]
Routine = Any  # of model/base/variant.py, or compiled
Phases = dict[Passes, tuple[Routine, ...]]
POSITIONS: Phases = {  # phases of passes; several passes: those that are done at once
    (EMIT,): (emit,), (PREDICT,): (predict,), (SORT,): (enter, tally, put), (FIND,): (find,), (FIND, DENSITY): (prepare,),
    (DENSITY,): (constrain,), (CORRECT,): (correct,), (UPDATE,): (update,), (SHAPE,): (shape,), (LIMIT,): (finish,),
}  # fmt: skip
SINKS: Phases = {(SORT,): (enter, drain, tally, put, rest)}
AMONG_SOLIDS: Phases = {
    (SAMPLE,): (solid_phases.sample,),
    (FIND,): (search, solid_phases.gather, solid_phases.factors),
    (FOLLOW,): (solid_phases.follow,),
    (DENSITY,): (solid_phases.constrain,),
    (CORRECT,): (solid_phases.correct,),
    (PUSH,): (solid_phases.push,),
}
FREE: Phases = {
    (GATHER,): (gather,), (SORT,): (enter, tally, put), (FIND,): (find,), (FIND, SURVEY): (divergence.find_and_survey,),
    (SURVEY,): (divergence.survey,), (RELAX,): (divergence.relax,), (PUSH_APART,): (divergence.push,),
    (TAKE_UP,): (divergence.take_up,), (SHAPE,): (divergence.shape,), (ACCELERATE,): (accelerate,),
    (FORESEE,): (divergence.foresee,), (MOVE,): (divergence.move,),
}  # fmt: skip


def phases_of(parts: frozenset[str]) -> Phases:
    """Return the phases of each pass, and of passes that are done at once."""
    if "divergence-free" in parts:
        return FREE
    return POSITIONS | (SINKS if "sink" in parts else {}) | (AMONG_SOLIDS if "solids" in parts else {})


def fused_passes(parts: frozenset[str]) -> list[Passes]:
    """Return the runs of passes of a substep that one phase does."""
    return [passes for passes in phases_of(parts) if len(passes) > 1]


phase = Open("phase(part, bands, at, world): the work of a band")
following = Open("following(team, member, bands, at, world): the phases after this one")
inside = Open("inside(team, member, bands, at, world): the phases of an iteration")
substep = Open("substep(team, member, bands, at, world): all phases of a substep")
always = open_constant("False for a phase that the first iteration leaves out")
solve = open_constant("True in the second solve of `divergence-free`")


@routine
def in_turn(team, member, bands, at, world):
    if always or at.iteration > 0:
        for part in assigned(team, member, bands):
            if FEATURE.flow:  # some phases change the number of active particles
                w, sizes = world, Sizes(world.flow.particles[0], world.sizes.capacity, world.sizes.nobody)
                now = Fluid(
                    sizes, w.state, w.unsorted, w.in_order, w.work, w.table, w.lists, w.scratch, w.parameters, w.fluids,
                    w.integers, w.bodies, w.kinds, w.flow, w.solids,
                )  # fmt: skip
                phase(part, bands, at, now)
            else:
                phase(part, bands, at, world)
    following(team, member, bands, at, world)


@routine
def iterated(team, member, bands, at, world):
    for iteration in range(at.iterations):
        inside(team, member, bands, At(at.step, at.number, iteration, at.iterations, solve), world)
    following(team, member, bands, at, world)


@routine
def nothing(team, member, bands, at, world):
    pass


@routine
def advance(team, member, bands, steps, step, substeps, iterations, world):
    for turn in range(steps * substeps):
        at = At(step + turn // substeps, step * substeps + turn, 0, iterations, False)
        substep(team, member, bands, at, world)


class _Composer:
    """Composes the phases of a fluid with `parts`, in a variant."""

    def __init__(self, real: Real, math: str, parts: frozenset[str]):
        self.parts, self.phases = parts, phases_of(parts)
        self.compiler = Compiler(f"fluid_{np.dtype(real).name}_{math}_{'_'.join(sorted(parts))}", math)
        features = fluid_features(parts)
        features |= {"neighbours": MAX_NEIGHBOURS[features["axes"]]}
        self.variant = self.compiler.variant_of(real, features)
        self.nothing = self.compiled(nothing, {})

    def compiled(self, routine: Routine, names: dict[str, Routine]) -> Routine:
        """Compile a part of a team's work with the open `names` replaced. It is not optimised on its own: each would be
        optimised with all that follows it."""
        return self.compiler.body(self.variant.copied(with_forces(filled(routine, names), self.parts)))

    def in_order(self, passes: Passes, after: Routine, always: bool = True) -> Routine:
        """Compile the phases of some passes, and then `after`."""
        for one in reversed(self.phases[passes]):
            after = self.compiled(in_turn, {"phase": one, "following": after, "always": always})
        return after

    def substep(self) -> Routine:
        """Compile the phases of a substep, in the order of its passes."""
        nodes, after = substep_of(self.parts), self.nothing
        runs = {(run.passes[0], run.iteration): run.passes for run in runs_of(nodes, 2, fused_passes(self.parts))}

        def before(one: Pass, after: Routine, iteration: int = 0) -> Routine:
            passes = runs.get((one.name, iteration))  # none if a phase of earlier passes does this one, too
            return self.in_order(passes, after, (one.name, 0) in runs) if passes else after

        for node in reversed(nodes):
            if isinstance(node, Iterations):
                body = self.nothing
                for one in reversed(node.passes):
                    body = before(one, body, 1)
                second = node.argument == SECOND
                after = self.compiled(iterated, {"inside": body, "following": after, "solve": second})
            else:
                after = before(node, after)
        return after


@cache
def make_advance(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, steps, step, substeps, iterations, world), which runs many steps in one call."""
    composer = _Composer(real, math, parts)
    return composer.compiler.team(composer.variant.copied(filled(advance, {"substep": composer.substep()})))


@cache
def make_pass(real: Real, math: str, parts: frozenset[str], name: str) -> Callable:
    """Compile a pass (bands, at, world), as a parallel loop, or by a team if it has several phases."""
    composer = _Composer(real, math, parts)
    phases = composer.phases[(name,)]
    if len(phases) == 1:
        return composer.compiler.banded(composer.variant(with_forces(phases[0], parts)))
    return composer.compiler.team(composer.in_order((name,), composer.nothing))
