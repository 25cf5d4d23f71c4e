"""CUDA kernels of the scheme `divergence-free`, one thread per particle (model/fluid/divergence_plan.py). The fourth
number of a position is the particle's fluid until the first `relax`, then the change of its multiplier.

Bytes per particle in float32, with n neighbours (28 in space), whose quads come from the caches; flop from the plan's
numbers: `survey` reads 4 n + 44 and writes 20, 40 n flop; `relax` reads 4 n + 60 and writes 12, 27 n; `push` reads 4 n
+ 56 and writes 16, 24 n; `foresee` reads 4 n + 40 and writes 4, 27 n; the others 60 to 100 and no sum. An iteration of
a solve is `relax` and `push`: at n = 28, 370 bytes and 1430 flop.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.kernels import WALL, wall_at
from softlab.gpu_backend.fluid.sums import List, pair, row, sum_correction, sum_density
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.gpu_backend.fluid.walls import walls
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid.density import constraint, moved, slope
from softlab.model.formulas.fluid.divergence import (
    approach_added,
    approach_of_wall,
    compressed,
    foreseen,
    lead,
    led,
    pressed,
)


@inlined_routine
def approach(k, p, vector, position, vectors, near_by, wall, parameters):
    """Return what a vector of each particle (quads; `vector`: that of particle k at p) contributes to C of particle k;
    `wall`: numbers, the last three of its gradient."""
    total, at = 0.0, np.int64(k)
    for _ in range(near_by.count):
        j = near_by.table[at]
        at += near_by.particles
        e = load_quad(vectors, j)
        dx, dy, dz, r = pair(k, p, j, load_quad(position, j), parameters)
        s = slope(r, parameters.inverse_support, parameters.gradient_scale)
        total = approach_added(total, s, dx, dy, dz, vector[0] - e[0], vector[1] - e[1], vector[2] - e[2])
    if FEATURE.walls:
        total = approach_of_wall(total, wall[1], wall[2], wall[3], vector[0], vector[1], vector[2])
    return total


@routine
def survey(
    position, velocity, record, table, neighbour_counts, constraints, gradients, targets, bodies, integers, counter,
    place, substeps, substep,
):  # fmt: skip
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        parameters, p, near_by = record[0], load_quad(position, k), List(table, neighbour_counts[k], particles)
        _, number = clock(counter, place, substeps, substep)
        wall, came = (0.0, 0.0, 0.0, 0.0), 0.0
        if FEATURE.walls:
            world, at = World(parameters, bodies, integers), np.int64(k) * WALL
            wall = walls(p, world, number)
            gradients[at], gradients[at + 1], gradients[at + 2] = wall[1], wall[2], wall[3]
            if FEATURE.moving:
                came = wall[0] - walls(p, world, number - 1)[0]
        total = sum_density(k, p, position, near_by, parameters)
        c = constraint(total, parameters.lattice_sum, parameters.density_scale, wall[0])
        constraints[k] = c
        vector = load_quad(velocity, k)
        a = approach(k, p, vector, position, velocity, near_by, wall, parameters)
        targets[k] = compressed(c, a, parameters.dt, came)


@routine
def foresee(position, velocity, record, table, neighbour_counts, constraints, gradients, targets):
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        parameters, p, near_by = record[0], load_quad(position, k), List(table, neighbour_counts[k], particles)
        wall, vector = wall_at(k, gradients), load_quad(velocity, k)
        a = approach(k, p, vector, position, velocity, near_by, wall, parameters)
        targets[k] = foreseen(constraints[k], a, parameters.dt)


@routine
def relax(
    position, shifts, record, table, neighbour_counts, gradients, targets, factors, aheads, iterates, turn, iterations
):  # fmt: skip
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        c, before, last = targets[k], 0.0, 0.0
        if turn > 0:
            p, near_by = load_quad(position, k), List(table, neighbour_counts[k], particles)
            before, last, vector = aheads[k], iterates[k], load_quad(shifts, k)
            c = c + approach(k, p, vector, position, shifts, near_by, wall_at(k, gradients), record[0])
        now = pressed(before, factors[k], c)
        ahead = led(now, last, lead(turn, iterations))
        aheads[k], iterates[k] = ahead, now
        position[SIZE * np.int64(k) + 3] = ahead - before  # not read by any thread of this launch


@routine
def push(position, shifts, record, table, neighbour_counts, gradients, before, fluids, turn):
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        p, near_by = load_quad(position, k), List(table, neighbour_counts[k], particles)
        e = 0.0, 0.0, 0.0, 0.0
        x, y, z = sum_correction(k, p, position, near_by, wall_at(k, gradients), record[0])
        if turn > 0:
            e = load_quad(shifts, k)
        weight = fluids[row(load_quad(before, k)[3]) + F_WEIGHT]
        store_quad(shifts, k, moved(e[0], weight, x), moved(e[1], weight, y), moved(e[2], weight, z), 0.0)


@cache
def make_targets(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `survey` and `foresee`.

    `survey(position, velocity, record, table, neighbour_counts, constraints, gradients, targets,
    *world)`: constraints, gradients
    of walls, and the targets of the first solve. `foresee(position, velocity, record, table, neighbour_counts, constraints,
    gradients, targets)`: the targets of the second solve. `world`: bodies, integers, counter, place, substeps, substep.
    """
    variant = fluid_variant(real, math, parts, repeats)
    return kernels_of(variant, math, (survey, foresee), f"fluid_{variant_name(real, math, parts, repeats)}")


@cache
def make_solve(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `relax` and `push`.

    `relax(position, shifts, record, table, neighbour_counts, gradients, targets, factors, aheads, iterates, turn,
    iterations)`: the changes of multipliers, into the fourth numbers of positions. `push(position, shifts, record,
    table, neighbour_counts, gradients, before, fluids, turn)`: shifts. `before`: quads whose fourth number is the
    particle's fluid.
    """
    variant = fluid_variant(real, math, parts, repeats)
    return kernels_of(variant, math, (relax, push), f"fluid_{variant_name(real, math, parts, repeats)}")
