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
from softlab.cpu_backend.core.own_forces import particle_force, with_forces
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.shape_matching.damping import gather_motion, slow
from softlab.cpu_backend.shape_matching.kernels import (
    AXES,
    SCRATCH,
    match_clusters,
    move_lone,
    move_particles,
    sum_up,
    turn_clusters,
)
from softlab.cpu_backend.shape_matching.particles import (
    NO_STEP,
    begin,
    begin_rigid,
    body_features,
    collide_particles,
    rate,
    store_impulses,
)
from softlab.cpu_backend.shape_matching.rebound import go, respond
from softlab.cpu_backend.shape_matching.rigid import gather_rigid, steady_particles
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, features_of, routine
from softlab.model.core.own_forces import particle_forces
from softlab.model.formulas.distance import damping_factor, kicked, predicted
from softlab.model.formulas.shape_matching.cluster import LANES
from softlab.model.formulas.shape_matching.rigid import travelled


@routine
def match(band, bands, position, count, arrays, rotation, new_rotation, frames, scratch):
    """Compute the rotations and frames of all clusters of a band."""
    clusters = arrays.centres.size // 4
    band_scratch = row_at(scratch, np.int64(SCRATCH * LANES * band))
    stop = clusters * (band + 1) // bands
    for first in range(clusters * band // bands, stop, LANES):
        match_clusters(
            first, min(first + LANES, stop), position, count, arrays, rotation, new_rotation, frames, band_scratch
        )


@routine
def move(band, bands, position, count, particle_clusters, frames, travel):
    """Move all particles of a band towards their goals."""
    move_particles(
        count * band // bands, count * (band + 1) // bands, position, count, particle_clusters, frames, travel
    )


@routine
def gravity(count, record, a):
    acceleration = record[0].gravity
    for k in prange(count):
        a[count + k] = a[count + k] + acceleration


@routine
def add_force(count, weights, record, integers, a):
    for k in prange(count):
        acceleration = particle_force(
            (a[k], a[count + k], a[2 * count + k]), k, weights[k], record[0], integers, NO_STEP
        )
        for axis in range(AXES):
            a[axis * count + k] = acceleration[axis]


@routine
def predict(count, before, position, velocity, weights, record, a, travel):
    h = record[0].dt
    for k in prange(AXES * count):
        before[k] = position[k]
        factor = damping_factor(record[0].braking, weights[k % count]) if FEATURE.damping else 1.0
        goes = not FEATURE.spare or weights[k % count] > 0.0
        goes_at = kicked(velocity[k], factor, h, a[k])
        position[k] = predicted(before[k], h, goes_at) if goes else before[k]
        if FEATURE.rigid_motion:
            travel[k] = travelled(h, goes_at)
        a[k] = 0.0


@routine
def update(band, bands, before, position, velocity, weights, count, parameters, travel):
    first, last = LANES * (count // LANES * band // bands), LANES * (count // LANES * (band + 1) // bands)
    rate(first, last, count, before, position, velocity, weights, parameters, travel)


@routine
def collide(band, bands, number, before, position, velocity, weights, world):
    first, last = weights.size * band // bands, weights.size * (band + 1) // bands
    collide_particles(first, last, number, before, position, velocity, weights, world)


@routine
def is_rigid(c, arrays):
    return FEATURE.rigid_motion and arrays.rigid.kinds[c] != 0


@routine
def begin_lone(first, last, c, before, after, b):
    """Predict the particles of a lone cluster `c`; of a rigid one also compute the velocities at the substep's end, as only
    matching moves it."""
    parameters, integers, count = b.world.parameters, b.world.integers, b.weights.size
    if FEATURE.rigid_motion and is_rigid(c, b.clusters):
        begin_rigid(first, last, count, before, after, b.velocity, b.weights, parameters, integers)
        return
    travel = b.clusters.rigid.travel if FEATURE.rigid_motion else b.weights
    begin(first, last, count, before, after, b.velocity, b.weights, parameters, integers, travel)


@routine
def end(first, last, low, high, lone, number, before, after, b, band_scratch):
    """Complete a substep of the particles `first` to before `last`, of the clusters `low` to before `high`, which may be one
    `lone` cluster, after they have moved to their goals; `b`: BodyArrays."""
    velocity, weights, arrays, count = b.velocity, b.weights, b.clusters, b.weights.size
    travel = arrays.rigid.travel if FEATURE.rigid_motion else weights
    if not (lone and is_rigid(low, arrays)):
        rate(first, last, count, before, after, velocity, weights, b.world.parameters, travel)
    if FEATURE.rigid_motion:
        for c in range(low, high):
            gather_rigid(c, after, velocity, count, arrays, band_scratch)
        if not lone:
            steady_particles(first, last, after, velocity, count, arrays)
    if FEATURE.cluster_damping:
        for c in range(low, high):
            gather_motion(c, after, velocity, count, arrays, arrays.damping.motions, band_scratch)
        slow(first, last, after, velocity, count, arrays)
    if FEATURE.rigid_rebound:
        store_impulses(first, last, number, before, after, velocity, weights, b.world, arrays.rebound.impulses)
        for c in range(low, high):
            respond(c, after, velocity, count, arrays, band_scratch)
        if not lone:
            go(first, last, after, velocity, count, arrays)
    elif FEATURE.colliders:
        collide_particles(first, last, number, before, after, velocity, weights, b.world)


@routine
def pass_lone(low, high, number, iterations, before, after, b, band_scratch):
    """Do a substep of lone clusters, `low` to before `high`."""
    arrays, starts, firsts, count = b.clusters, b.clusters.starts, b.clusters.firsts, b.weights.size
    travel = arrays.rigid.travel if FEATURE.rigid_motion else b.weights
    for iteration in range(iterations):
        for c in range(low, high):
            first = np.int64(firsts[c])
            if iteration == 0:
                last = first + (starts[c + 1] - starts[c])
                begin_lone(first, last, c, before, after, b)
            sum_up(c, c - low, after, count, arrays, band_scratch)
        turn_clusters(low, high, after, count, arrays, b.rotation, b.rotation, b.frames, band_scratch)
        for c in range(low, high):
            move_lone(c, after, count, arrays, b.factors, b.frames, travel)
            if iteration == iterations - 1:
                first = np.int64(firsts[c])
                last = first + (starts[c + 1] - starts[c])
                end(first, last, c, c + 1, True, number, before, after, b, band_scratch)


@routine
def pass_any(first, last, low, high, number, iterations, before, after, b, band_scratch):
    """Do a substep of the particles `first` to before `last`, of the clusters `low` to before `high`."""
    arrays, count = b.clusters, b.weights.size
    travel = arrays.rigid.travel if FEATURE.rigid_motion else b.weights
    begin(
        first, last, count, before, after, b.velocity, b.weights, b.world.parameters, b.world.integers, travel
    )  # fmt: skip
    for _ in range(iterations):
        for c in range(low, high, LANES):
            match_clusters(
                c, min(c + LANES, high), after, count, arrays, b.rotation, b.rotation, b.frames, band_scratch
            )
        move_particles(first, last, after, count, b.own, b.frames, travel)
    end(first, last, low, high, False, number, before, after, b, band_scratch)


@routine
def advance(band, bands, bounds, groups, steps, even, odd, b):
    """Advance the groups of a band by `steps.steps` steps."""
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
    copied = compiler.variant_of(real, features_of(shaping) | {"rigid_motion": has_rigid}).copied
    return SimpleNamespace(match=compiler.banded(copied(match)), move=compiler.banded(copied(move)))


@cache
def make_bodies_stages(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile the stages of single particles, one parallel loop each: `gravity`, `add_force` by name, `predict`, `update`,
    `collide`. `count`: particles and ghosts; `a`: three planes of accelerations, 0 after a prediction."""
    compiler = Compiler(cloth_variant("bodies_stages", real, math, parts), math)
    copied = compiler.variant_of(real, body_features(parts)).copied

    def stage_of(part: str) -> Callable:
        return compiler.kernel(copied(with_forces(add_force, frozenset({part}))))

    return SimpleNamespace(
        gravity=compiler.kernel(copied(gravity)),
        particle_forces={force.stage: stage_of(force.part) for force in particle_forces(parts)},
        predict=compiler.kernel(copied(predict)), update=compiler.banded(copied(update)),
        collide=compiler.banded(copied(collide)),
    )  # fmt: skip


@cache
def make_bodies_apart(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Compile advance(bands, bounds, groups, steps, even, odd, b): many steps in one call; `steps`: Steps; `b`:
    BodyArrays.

    Groups of bodies are independent, so a thread takes a group, which fits in its second-level cache, through all
    steps. `bounds` (bands + 1,): the bands' first groups; `groups` (groups, 5) int64: first and last particle, first
    and last cluster, 1 if they are lone; `even`: positions at the start, and after every other substep.
    """
    compiler = Compiler(cloth_variant("bodies_apart", real, math, parts), math)
    kernel = compiler.variant_of(real, body_features(parts)).copied(with_forces(advance, parts))
    return compiler.banded(kernel)
