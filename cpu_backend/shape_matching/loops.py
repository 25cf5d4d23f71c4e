"""The loops of bodies over many steps, and stage by stage: the distribution of particles and clusters over threads.

In `exact` math all give the same bits, for any number of threads. shape_matching/kernels.py has the operations.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import row_at
from softlab.cpu_backend.core.own_forces import make_particle_force
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.shape_matching.damping import make_damping
from softlab.cpu_backend.shape_matching.kernels import AXES, SCRATCH, make_matching
from softlab.cpu_backend.shape_matching.particles import make_particles
from softlab.cpu_backend.shape_matching.rebound import make_rebound
from softlab.cpu_backend.shape_matching.rigid import make_steadying
from softlab.model.base.types import Real
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas import distance
from softlab.model.formulas.shape_matching import rigid
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.shape_matching.cluster_tables import shaping
from softlab.model.tables.cloth import COLLIDER_KINDS


@cache
def make_matching_stages(
    real: Real, math: str, shaping: frozenset[str] = frozenset(), has_rigid: bool = False
) -> SimpleNamespace:
    """Compile `match(bands, position, count, arrays, rotation, new_rotation, frames, scratch)`, for all clusters, and
    `move(bands, position, count, particle_clusters, frames, travel)`, for all particles: one parallel loop each, over
    `bands` bands.

    `count`: particles and ghosts; `scratch`: flat, SCRATCH * LANES per band.
    """
    compiler = Compiler("_".join(["bodies", np.dtype(real).name, math, *sorted(shaping), "rigid" * has_rigid]), math)
    functions = make_matching(real, math, shaping, has_rigid)
    match_some, move_some = functions.match, functions.move

    def match(band, bands, position, count, arrays, rotation, new_rotation, frames, scratch):
        clusters = arrays.centres.size // 4
        band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
        stop = clusters * (band + 1) // bands
        for first in range(clusters * band // bands, stop, LANES):
            match_some(
                first, min(first + LANES, stop), position, count, arrays, rotation, new_rotation, frames, band_scratch
            )

    def move(band, bands, position, count, particle_clusters, frames, travel):
        move_some(
            count * band // bands, count * (band + 1) // bands, position, count, particle_clusters, frames, travel
        )

    return SimpleNamespace(match=compiler.banded(match), move=compiler.banded(move))


@cache
def make_bodies_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages of single particles, one parallel loop each: `gravity`, `add_force` by name, `predict`, `update`,
    `collide`. `count`: particles and ghosts; `a`: three planes of accelerations, 0 after a prediction."""
    compiler = Compiler(cloth_variant("bodies_stages", real, math, parts), math)
    functions = make_particles(compiler, real, parts)
    rate_some, collide_some = functions.rate, functions.collide

    formulas = compiler.formulas(distance, real)
    kicked, damping_factor, predicted = formulas.kicked, formulas.damping_factor, formulas.predicted
    no_step = np.int64(0)
    has_damping, has_spare, zero, one = "damping" in parts, "spare" in parts, real(0), real(1)
    travelled, has_rigid = compiler.formulas(rigid, real).travelled, "rigid-motion" in parts

    def gravity(count, record, a):
        gravity = record[0].gravity
        for k in prange(count):
            a[count + k] = a[count + k] + gravity

    def stage_of(part: str) -> Callable:
        add_force = make_particle_force(compiler, real, AXES, frozenset({part, "load"}))

        def particle_force(count, weights, record, integers, a):
            for k in prange(count):
                acceleration = add_force(
                    (a[k], a[count + k], a[2 * count + k]), k, weights[k], record[0], integers, no_step
                )
                for axis in range(AXES):
                    a[axis * count + k] = acceleration[axis]

        return compiler.kernel(particle_force)

    def predict(count, before, position, velocity, weights, record, a, travel):
        h = record[0].dt
        for k in prange(AXES * count):
            before[k] = position[k]
            factor = damping_factor(record[0].braking, weights[k % count]) if has_damping else one
            goes = not has_spare or weights[k % count] > zero
            goes_at = kicked(velocity[k], factor, h, a[k])
            position[k] = predicted(before[k], h, goes_at) if goes else before[k]
            if has_rigid:
                travel[k] = travelled(h, goes_at)
            a[k] = zero

    def update(band, bands, before, position, velocity, weights, count, parameters, travel):
        first, last = LANES * (count // LANES * band // bands), LANES * (count // LANES * (band + 1) // bands)
        rate_some(first, last, count, before, position, velocity, weights, parameters, travel)

    def collide(band, bands, number, before, position, velocity, weights, world):
        first, last = weights.size * band // bands, weights.size * (band + 1) // bands
        collide_some(first, last, number, before, position, velocity, weights, world)

    return SimpleNamespace(
        gravity=compiler.kernel(gravity),
        particle_forces={force.stage: stage_of(force.part) for force in particle_forces(parts)},
        predict=compiler.kernel(predict), update=compiler.banded(update), collide=compiler.banded(collide),
    )  # fmt: skip


def make_substep_end(compiler: Compiler, real: Real, parts: frozenset[str]) -> SimpleNamespace:
    """Make `begin(first, last, c, ...)`, for the particles of a lone cluster c, and `end(first, last, low, high, lone,
    number, before, after, b, band_scratch)`; `b`: BodyArrays.

    `end` completes a substep of the particles `first` to before `last`, of the clusters `low` to before `high`, which
    may be one `lone` cluster, after they have moved to their goals.
    """
    of_one, has_damping = make_particles(compiler, real, parts), "cluster_damping" in parts
    begin_any, begin_rigid = of_one.begin, of_one.begin_rigid
    rate, collide, store_impulses, has_bodies = (
        of_one.rate,
        of_one.collide,
        of_one.store_impulses,
        bool(parts & set(COLLIDER_KINDS)),
    )
    damping, rebounds = make_damping(compiler, real, has_damping), "rigid-rebound" in parts
    gather, slow, whole = damping.gather, damping.slow, make_rebound(compiler, real, rebounds)
    respond, go, has_rigid = whole.response, whole.go, "rigid-motion" in parts
    steadying = make_steadying(compiler, real, has_rigid)
    gather_rigid, steady = steadying.gather, steadying.steady

    @compiler.compiled
    def is_rigid(c, arrays):
        if has_rigid:
            return arrays.rigid.kinds[c] != 0
        return False

    @compiler.compiled
    def begin(first, last, c, before, after, b):
        """Predict the particles; for a rigid cluster also compute the velocities at the substep's end, as only matching
        moves it."""
        parameters, integers, count = b.world.parameters, b.world.integers, b.weights.size
        if has_rigid:
            if is_rigid(c, b.clusters):
                begin_rigid(first, last, count, before, after, b.velocity, b.weights, parameters, integers)
                return
        travel = b.clusters.rigid.travel if has_rigid else b.weights
        begin_any(first, last, count, before, after, b.velocity, b.weights, parameters, integers, travel)

    @compiler.compiled
    def end(first, last, low, high, lone, number, before, after, b, band_scratch):
        velocity, weights, arrays, count = b.velocity, b.weights, b.clusters, b.weights.size
        travel = arrays.rigid.travel if has_rigid else weights
        if not (lone and is_rigid(low, arrays)):
            rate(first, last, count, before, after, velocity, weights, b.world.parameters, travel)
        if has_rigid:
            for c in range(low, high):
                gather_rigid(c, after, velocity, count, arrays, band_scratch)
            if not lone:
                steady(first, last, after, velocity, count, arrays)
        if has_damping:
            for c in range(low, high):
                gather(c, after, velocity, count, arrays, arrays.damping.motions, band_scratch)
            slow(first, last, after, velocity, count, arrays)
        if rebounds:
            store_impulses(first, last, number, before, after, velocity, weights, b.world, arrays.rebound.impulses)
            for c in range(low, high):
                respond(c, after, velocity, count, arrays, band_scratch)
            if not lone:
                go(first, last, after, velocity, count, arrays)
        elif has_bodies:
            collide(first, last, number, before, after, velocity, weights, b.world)

    return SimpleNamespace(begin=begin, end=end)


@cache
def make_bodies_apart(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, bounds, groups, steps, even, odd, b): many steps in one call; `steps`: Steps; `b`:
    BodyArrays.

    Groups of bodies are independent, so a thread takes a group, which fits in its second-level cache, through all
    steps. `bounds` (bands + 1,): the bands' first groups; `groups` (groups, 5) int64: first and last particle, first
    and last cluster, 1 if they are lone; `even`: positions at the start, and after every other substep.
    """
    compiler = Compiler(cloth_variant("bodies_apart", real, math, parts), math)
    has_rigid = "rigid-motion" in parts
    begin, functions = make_particles(compiler, real, parts).begin, make_matching(real, math, shaping(parts), has_rigid)
    match, move, sum_up, turn, move_lone = (
        functions.match,
        functions.move,
        functions.sum_up,
        functions.turn,
        functions.move_lone,
    )
    of_substep = make_substep_end(compiler, real, parts)
    begin_lone, end = of_substep.begin, of_substep.end

    @compiler.compiled
    def pass_lone(low, high, number, iterations, before, after, b, band_scratch):
        arrays, starts, firsts, count = b.clusters, b.clusters.starts, b.clusters.firsts, b.weights.size
        travel = arrays.rigid.travel if has_rigid else b.weights
        for iteration in range(iterations):
            for c in range(low, high):
                first = np.int64(firsts[c])
                if iteration == 0:
                    last = first + (starts[c + 1] - starts[c])
                    begin_lone(first, last, c, before, after, b)
                sum_up(c, c - low, after, count, arrays, band_scratch)
            turn(low, high, after, count, arrays, b.rotation, b.rotation, b.frames, band_scratch)
            for c in range(low, high):
                move_lone(c, after, count, arrays, b.factors, b.frames, travel)
                if iteration == iterations - 1:
                    first = np.int64(firsts[c])
                    last = first + (starts[c + 1] - starts[c])
                    end(first, last, c, c + 1, True, number, before, after, b, band_scratch)

    @compiler.compiled
    def pass_any(first, last, low, high, number, iterations, before, after, b, band_scratch):
        arrays, count = b.clusters, b.weights.size
        travel = arrays.rigid.travel if has_rigid else b.weights
        begin(
            first, last, count, before, after, b.velocity, b.weights, b.world.parameters, b.world.integers, travel
        )  # fmt: skip
        for _ in range(iterations):
            for c in range(low, high, LANES):
                match(c, min(c + LANES, high), after, count, arrays, b.rotation, b.rotation, b.frames, band_scratch)
            move(first, last, after, count, b.own, b.frames, travel)
        end(first, last, low, high, False, number, before, after, b, band_scratch)

    def advance(band, bands, bounds, groups, steps, even, odd, b):
        band_scratch = row_at(b.scratch, np.int64(SCRATCH * LANES * band))
        for g in range(bounds[band], bounds[band + 1]):
            first, last, low, high, lone = groups[g, 0], groups[g, 1], groups[g, 2], groups[g, 3], groups[g, 4]
            for n in range(steps.steps * steps.substeps):
                number, iterations = steps.step * steps.substeps + n, steps.iterations
                before, after = (odd, even) if n % 2 else (even, odd)
                if lone:
                    for c in range(low, high, LANES):
                        pass_lone(c, min(c + LANES, high), number, iterations, before, after, b, band_scratch)
                else:
                    pass_any(first, last, low, high, number, iterations, before, after, b, band_scratch)

    return compiler.banded(advance)
