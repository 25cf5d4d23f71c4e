"""CUDA kernels of the scheme `divergence-free`, one thread per particle (model/fluid/divergence_plan.py). The fourth
number of a position is the particle's fluid until the first `relax`, then the change of its multiplier.

Bytes per particle in float32, with n neighbours (28 in space), whose quads come from the caches; flop from the plan's
numbers: `survey` reads 4 n + 44 and writes 20, 40 n flop; `relax` reads 4 n + 60 and writes 12, 27 n; `push` reads 4 n
+ 56 and writes 16, 24 n; `foresee` reads 4 n + 40 and writes 4, 27 n; the others 60 to 100 and no sum. An iteration of
a solve is `relax` and `push`: at n = 28, 370 bytes and 1430 flop.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.kernels import WALL
from softlab.gpu_backend.fluid.sums import List, make_pair, make_row, make_sums
from softlab.gpu_backend.fluid.walls import make_walls
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid import density, divergence


@cache
def make_approach(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> Callable:
    """Make approach(k, p, vector, position, vectors, near_by, wall, parameters).

    It returns what a vector of each particle (quads; `vector`: that of particle k at p) contributes to C of particle k;
    `wall`: numbers, the last three of its gradient.
    """
    g, f = device_formulas(divergence, real, math), device_formulas(density, real, math)
    added, of_wall, slope, pair = (
        g.approach_added,
        g.approach_of_wall,
        f.slope,
        make_pair(real, math, repeats),
    )
    has_walls, zero = "walls" in parts, real(0)

    @inlined(math)
    def approach(k, p, vector, position, vectors, near_by, wall, parameters):
        total, at = zero, np.int64(k)
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            e = load_quad(vectors, j)
            dx, dy, dz, r = pair(k, p, j, load_quad(position, j), parameters)
            s = slope(r, parameters.inverse_support, parameters.gradient_scale)
            total = added(total, s, dx, dy, dz, vector[0] - e[0], vector[1] - e[1], vector[2] - e[2])
        if has_walls:
            total = of_wall(total, wall[1], wall[2], wall[3], vector[0], vector[1], vector[2])
        return total

    return approach


@cache
def make_targets(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `survey` and `foresee`.

    `survey(position, velocity, record, table, neighbour_counts, constraints, gradients, targets,
    *world)`: constraints, gradients
    of walls, and the targets of the first solve. `foresee(position, velocity, record, table, neighbour_counts, constraints,
    gradients, targets)`: the targets of the second solve. `world`: bodies, integers, counter, place, substeps, substep.
    """
    g, f = device_formulas(divergence, real, math), device_formulas(density, real, math)
    compressed, foreseen, constraint = g.compressed, g.foreseen, f.constraint
    approach, sum_density = make_approach(real, math, parts, repeats), make_sums(real, math, parts, repeats).sum_density
    walls, clock, wall_at = make_walls(real, math, parts), make_clock(math, parts), make_wall_at(real, math, parts)
    has_walls, moving, zero = "walls" in parts, "moving" in parts, real(0)
    axes, one = np.int32(WALL), np.int64(1)

    def survey(
        position, velocity, record, table, neighbour_counts, constraints, gradients, targets, bodies, integers, counter,
        place, substeps, substep,
    ):  # fmt: skip
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            parameters, p, near_by = record[0], load_quad(position, k), List(table, neighbour_counts[k], particles)
            _, number = clock(counter, place, substeps, substep)
            wall, came = (zero, zero, zero, zero), zero
            if has_walls:
                world, at = World(parameters, bodies, integers), np.int64(k) * axes
                wall = walls(p, world, number)
                gradients[at], gradients[at + 1], gradients[at + 2] = wall[1], wall[2], wall[3]
                if moving:
                    came = wall[0] - walls(p, world, number - one)[0]
            total = sum_density(k, p, position, near_by, parameters)
            c = constraint(total, parameters.lattice_sum, parameters.density_scale, wall[0])
            constraints[k] = c
            vector = load_quad(velocity, k)
            a = approach(k, p, vector, position, velocity, near_by, wall, parameters)
            targets[k] = compressed(c, a, parameters.dt, came)

    def foresee(position, velocity, record, table, neighbour_counts, constraints, gradients, targets):
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            parameters, p, near_by = record[0], load_quad(position, k), List(table, neighbour_counts[k], particles)
            wall, vector = wall_at(k, gradients), load_quad(velocity, k)
            a = approach(k, p, vector, position, velocity, near_by, wall, parameters)
            targets[k] = foreseen(constraints[k], a, parameters.dt)

    name = f"fluid_{variant_name(real, math, parts, repeats)}"
    return make_kernels((survey, foresee), name, **kernel_options(math))


@cache
def make_wall_at(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make wall_at(k, gradients): four numbers, the last three of which are the wall gradient of particle k."""
    has_walls, zero, axes = "walls" in parts, real(0), np.int32(WALL)

    @inlined(math)
    def wall_at(k, gradients):
        if has_walls:
            at = np.int64(k) * axes
            return zero, gradients[at], gradients[at + 1], gradients[at + 2]
        return zero, zero, zero, zero

    return wall_at


@cache
def make_solve(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `relax` and `push`.

    `relax(position, shifts, record, table, neighbour_counts, gradients, targets, factors, aheads, iterates, turn,
    iterations)`: the changes of multipliers, into the fourth numbers of positions. `push(position, shifts, record,
    table, neighbour_counts, gradients, before, fluids, turn)`: shifts. `before`: quads whose fourth number is the
    particle's fluid.
    """
    g, formulas = device_formulas(divergence, real, math), device_formulas(density, real, math)
    pressed, lead, led, moved = g.pressed, g.lead, g.led, formulas.moved
    approach, sum_correction = (
        make_approach(real, math, parts, repeats),
        make_sums(real, math, parts, repeats).sum_correction,
    )
    wall_at, row, weight_field = make_wall_at(real, math, parts), make_row(parts), np.int32(F_WEIGHT)
    zero, last_number = real(0), np.int32(SIZE - 1)

    def relax(
        position, shifts, record, table, neighbour_counts, gradients, targets, factors, aheads, iterates, turn, iterations
    ):  # fmt: skip
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            c, before, last = targets[k], zero, zero
            if turn > 0:
                p, near_by = load_quad(position, k), List(table, neighbour_counts[k], particles)
                before, last, vector = aheads[k], iterates[k], load_quad(shifts, k)
                c = c + approach(k, p, vector, position, shifts, near_by, wall_at(k, gradients), record[0])
            now = pressed(before, factors[k], c)
            ahead = led(now, last, lead(turn, iterations))
            aheads[k], iterates[k] = ahead, now
            position[SIZE * np.int64(k) + last_number] = ahead - before  # not read by any thread of this launch

    def push(position, shifts, record, table, neighbour_counts, gradients, before, fluids, turn):
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            p, near_by, e = (
                load_quad(position, k),
                List(table, neighbour_counts[k], particles),
                (zero, zero, zero, zero),
            )
            x, y, z = sum_correction(k, p, position, near_by, wall_at(k, gradients), record[0])
            if turn > 0:
                e = load_quad(shifts, k)
            weight = fluids[row(load_quad(before, k)[3]) + weight_field]
            store_quad(shifts, k, moved(e[0], weight, x), moved(e[1], weight, y), moved(e[2], weight, z), zero)

    name = f"fluid_{variant_name(real, math, parts, repeats)}"
    return make_kernels((relax, push), name, **kernel_options(math))
