"""CUDA kernels of a fluid's constraint: lists, factors, densities and corrections, one thread per particle.

`stages` runs `find`, `factors`, `density` and `correct` of model/fluid/plan.py one by one. The other kernels fuse
stages that need no neighbour's result: `prepare` is the first three, all at the predicted positions, and `settle`
(gpu_backend/fluid/motion.py) a substep's last correction and what follows. In `exact` math both give the same bits.

Bytes per particle in float32, with n neighbours (28 in space), whose quads come from the caches; flop from
model/fluid/plan.py: `prepare` reads 36 and writes 4 n + 32, 9 flop per candidate (160) and 39 n; `density` reads 4 n +
32, writes 8, 13 n; `correct` reads 4 n + 36, writes 16, 24 n. At n = 28 an iteration takes 316 bytes and 1040 flop: on
an H200 (4.0 TB/s measured, 31 TFLOP/s at half of peak) memory limits it to 12.6e9 particle-iterations/s, arithmetic to
30e9.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import kernel_options, kernels_of, make_kernels, variant_name
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.extent import extent
from softlab.gpu_backend.fluid.lists import LANES, Grid, search
from softlab.gpu_backend.fluid.sums import (
    List,
    both_added,
    factor_of,
    row,
    sum_correction,
    sum_density,
    sum_factor,
    weights_of,
)
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.gpu_backend.fluid.walls import walls
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, filled, inlined_routine, routine
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid.density import change, change_alone, constraint, moved

WALL = 3  # numbers of a wall's gradient


def walk_options(real: Real, math: str) -> dict[str, Any]:
    """Return the compile options of kernels that traverse lists, in blocks of LANES threads at most.

    They leave registers for the loads of four neighbours in flight. By default the compiler uses fewer registers and
    waits for one load after the other.
    """
    return kernel_options(math) | {"launch_bounds": (LANES, 6 if real is np.float32 else 3)}


@inlined_routine
def relax(k, total, wall, factor, multipliers, constraints, parameters, first):
    """Return the change of particle k's multiplier. `first`: the multiplier was 0."""
    c = constraint(total, parameters.lattice_sum, parameters.density_scale, wall)
    if FEATURE.drag:
        constraints[k] = c
    multiplier = 0.0 if first else multipliers[k]
    delta = change_alone(factor, c) if FEATURE.averaged else change(multiplier, factor, c)
    multipliers[k] = multiplier + delta
    return delta


@inlined_routine
def wall_at(k, gradients):
    """Return four numbers, the last three of which are the wall gradient of particle k."""
    if FEATURE.walls:
        at = np.int64(k) * WALL
        return 0.0, gradients[at], gradients[at + 1], gradients[at + 2]
    return 0.0, 0.0, 0.0, 0.0


@inlined_routine
def move(k, p, b, position, near_by, gradients, fluids, world, number):
    """Return the position of particle k, now at p and at b before the substep, after a correction and the colliders.

    `gradients`: of walls, three numbers per particle.
    """
    x, y, z = sum_correction(k, p, position, near_by, wall_at(k, gradients), world.parameters)
    weight = fluids[row(b[3]) + F_WEIGHT]
    x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
    x, y, z, _, _, _ = collide(b, x, y, z, 0.0, 0.0, 0.0, world, number)
    return x, y, z


@inlined_routine
def nothing_added(sums, k, p, j, position, fluids, parameters):
    return sums


search_alone = filled(search, {"visit": nothing_added, "begun": 0.0})
search_and_sum = filled(search, {"visit": both_added, "begun": (0.0, 0.0, 0.0, 0.0, 0.0)})


@inlined_routine
def wall_terms(k, p, gradients, world, number):
    """Return (density, gx, gy, gz), the contribution of walls at p, the position of particle k; store its gradient."""
    wall = 0.0, 0.0, 0.0, 0.0
    if FEATURE.walls:
        wall = walls(p, world, number)
        at = np.int64(k) * WALL
        gradients[at], gradients[at + 1], gradients[at + 2] = wall[1], wall[2], wall[3]
    return wall


@routine
def find(position, record, keys, numbers, begins, table, neighbour_counts, beyond):
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        p = load_quad(position, k)
        neighbour_counts[k], _ = search_alone(
            k, p, position, record[0], Grid(keys[k], numbers, begins), table, particles, beyond, None
        )


@routine
def prepare(
    position, record, keys, numbers, begins, table, neighbour_counts, beyond, factors, multipliers, constraints,
    gradients, fluids, bodies, integers, counter, place, substeps, substep, into,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        parameters, p = record[0], load_quad(position, k)
        count, (gx, gy, gz, squares, total) = search_and_sum(
            k, p, position, parameters, Grid(keys[k], numbers, begins), table, particles, beyond, weights_of(fluids)
        )
        neighbour_counts[k] = count
        _, number = clock(counter, place, substeps, substep)
        wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), number)
        factor = factor_of(p, (gx, gy, gz, squares), wall, fluids, parameters)
        factors[k] = factor
        delta = relax(k, total, wall[0], factor, multipliers, constraints, parameters, True)
        store_quad(into, k, p[0], p[1], p[2], delta)


@routine
def factors(
    position, record, table, neighbour_counts, factors_, multipliers, constraints, gradients, fluids, bodies,
    integers, counter, place, substeps, substep,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        parameters, p = record[0], load_quad(position, k)
        _, number = clock(counter, place, substeps, substep)
        wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), number)
        near_by = List(table, neighbour_counts[k], particles)
        factors_[k] = sum_factor(k, p, position, near_by, wall, fluids, parameters)
        multipliers[k] = 0.0


@routine
def density(
    position, record, table, neighbour_counts, factors, multipliers, constraints, gradients, bodies, integers,
    counter, place, substeps, substep,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        parameters, p = record[0], load_quad(position, k)
        _, number = clock(counter, place, substeps, substep)
        wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), number)
        total = sum_density(k, p, position, List(table, neighbour_counts[k], particles), parameters)
        delta = relax(k, total, wall[0], factors[k], multipliers, constraints, parameters, False)
        position[SIZE * np.int64(k) + 3] = delta  # not read by any thread of this launch


@routine
def correct(
    before, position, record, table, neighbour_counts, gradients, fluids, bodies, integers, counter, place,
    substeps, substep, into,
):  # fmt: skip
    k = np.int32(cuda.grid(1))
    particles, there = extent(neighbour_counts)
    if k < there:
        p, b, near_by = load_quad(position, k), load_quad(before, k), List(table, neighbour_counts[k], particles)
        _, number = clock(counter, place, substeps, substep)
        world = World(record[0], bodies, integers)
        x, y, z = move(k, p, b, position, near_by, gradients, fluids, world, number)
        store_quad(into, k, x, y, z, b[3])


@cache
def make_density_kernels(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str], neighbours: int
) -> SimpleNamespace:
    """Compile the kernels of the density constraint, for blocks of LANES threads at most.

    `find(position, record, *grid, *list, beyond)`; `prepare(position, record, *grid, *list, beyond, *relaxed, fluids,
    *world, into)`; `factors(position, record, *list, *relaxed, fluids, *world)`; `density(position, record, *list,
    *relaxed, *world)`, which writes into the fourth numbers of positions; `correct(before, position, record, *list,
    gradients, fluids, *world, into)`. `grid`: keys, numbers, begins, of gpu_backend/fluid/cells.py; `list`: table,
    found; `relaxed`: factors, multipliers, constraints, gradients; `world`: bodies, integers, counter, place, substeps,
    substep.
    """
    variant = fluid_variant(real, math, parts, repeats, {"neighbours": neighbours})
    label = f"fluid_{variant_name(real, math, parts, repeats)}"
    searching = kernels_of(variant, math, (find, prepare), label)
    walking = map(variant.copied, (factors, density, correct))
    return SimpleNamespace(**vars(searching), **vars(make_kernels(walking, label, **walk_options(real, math))))
