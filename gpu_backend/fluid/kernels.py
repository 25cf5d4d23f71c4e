"""CUDA kernels of a fluid's constraint: lists, factors, densities and corrections, one thread per particle.

`stages` runs `find`, `factors`, `density` and `correct` of model/fluid/plan.py one by one. The other kernels fuse what
needs no neighbour's result: `prepare` is the first three, all at the predicted positions, and `settle`
(gpu_backend/fluid/motion.py) a substep's last correction and what follows. In `exact` math both give the same bits.

Bytes per particle in float32, with n neighbours (28 in space), whose quads come from the caches; flop from
model/fluid/plan.py: `prepare` reads 36 and writes 4 n + 32, 9 flop per candidate (160) and 39 n; `density` reads 4 n +
32, writes 8, 13 n; `correct` reads 4 n + 36, writes 16, 24 n. At n = 28 an iteration takes 316 bytes and 1040 flop: on
an H200 (4.0 TB/s measured, 31 TFLOP/s at half of peak) memory limits it to 12.6e9 particle-iterations/s, arithmetic to
30e9.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.extent import make_extent
from softlab.gpu_backend.fluid.lists import LANES, make_search
from softlab.gpu_backend.fluid.sums import List, make_row, make_sums
from softlab.gpu_backend.fluid.walls import make_walls
from softlab.model.base.types import Real
from softlab.model.fluid.parameters import F_WEIGHT
from softlab.model.formulas.fluid import density

WALL = 3  # numbers of a wall's gradient


def walk_options(real: Real, math: str) -> dict[str, Any]:
    """Return the compile options of kernels that traverse lists, in blocks of LANES threads at most.

    They leave registers for the loads of four neighbours in flight. By default the compiler uses fewer registers and
    waits for one load after the other.
    """
    return kernel_options(math) | {"launch_bounds": (LANES, 6 if real is np.float32 else 3)}


@cache
def make_relax(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make relax(k, total, wall, factor, multipliers, constraints, parameters, first) -> change of particle k's
    multiplier.

    `first`: the multiplier was 0.
    """
    formulas = device_formulas(density, real, math)
    constraint, change, change_alone = formulas.constraint, formulas.change, formulas.change_alone
    alone, keeps, zero = "averaged" in parts, "drag" in parts, real(0)

    @inlined(math)
    def relax(k, total, wall, factor, multipliers, constraints, parameters, first):
        c = constraint(total, parameters.lattice_sum, parameters.density_scale, wall)
        if keeps:
            constraints[k] = c
        multiplier = zero if first else multipliers[k]
        delta = change_alone(factor, c) if alone else change(multiplier, factor, c)
        multipliers[k] = multiplier + delta
        return delta

    return relax


@cache
def make_move(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> Callable:
    """Make move(k, p, b, position, near_by, gradients, fluids, world, number) -> (x, y, z).

    It returns the position of particle k, now at p and at b before the substep, after a correction and the colliders.
    `gradients`: of walls, three numbers per particle.
    """
    sums, collide = make_sums(real, math, parts, repeats), make_collide(real, math, parts)
    formulas, sum_correction, row = device_formulas(density, real, math), sums.sum_correction, make_row(parts)
    moved, weight_field = formulas.moved, np.int32(F_WEIGHT)
    has_walls, zero, axes = "walls" in parts, real(0), np.int32(WALL)

    @inlined(math)
    def move(k, p, b, position, near_by, gradients, fluids, world, number):
        wall = zero, zero, zero, zero
        if has_walls:
            at = np.int64(k) * axes
            wall = zero, gradients[at], gradients[at + 1], gradients[at + 2]
        x, y, z = sum_correction(k, p, position, near_by, wall, world.parameters)
        weight = fluids[row(b[3]) + weight_field]
        x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
        x, y, z, _, _, _ = collide(b, x, y, z, zero, zero, zero, world, number)
        return x, y, z

    return move


@cache
def _make_nothing_added() -> Callable:
    @inlined("exact")
    def visit(sums, k, p, j, position, fluids, parameters):
        return sums

    return visit


@cache
def make_wall_terms(real: Real, math: str, parts: frozenset[str]) -> Callable:
    """Make wall_terms(k, p, gradients, world, number) -> (density, gx, gy, gz), the contribution of walls at p, the
    position of particle k; their gradient is stored."""
    walls, has_walls, numbers_each, zero = make_walls(real, math, parts), "walls" in parts, np.int32(WALL), real(0)

    @inlined(math)
    def wall_terms(k, p, gradients, world, number):
        """Return the contribution of walls at p, and store its gradient."""
        wall = zero, zero, zero, zero
        if has_walls:
            wall = walls(p, world, number)
            at = np.int64(k) * numbers_each
            gradients[at], gradients[at + 1], gradients[at + 2] = wall[1], wall[2], wall[3]
        return wall

    return wall_terms


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
    searching = _make_searching(real, math, parts, repeats, neighbours)
    return SimpleNamespace(**vars(searching), **vars(_make_walking(real, math, parts, repeats)))


def _make_searching(
    real: Real, math: str, parts: frozenset[str], repeats: frozenset[str], neighbours: int
) -> SimpleNamespace:
    """Compile `find` and `prepare`."""
    variant, axes, extent = (real, math, parts), 2 if "flat" in parts else 3, make_extent(parts)
    sums, relax = make_sums(*variant, repeats), make_relax(*variant)
    factor_of, weights_of, zero = sums.factor_of, sums.weights_of, real(0)
    wall_terms, clock = make_wall_terms(*variant), make_clock(math, parts)
    shape = real, math, axes, neighbours, repeats
    search = make_search(*shape, _make_nothing_added(), zero, "solids" in parts)
    search_and_sum = make_search(*shape, sums.both_added, (zero, zero, zero, zero, zero), "solids" in parts)

    def find(position, record, keys, numbers, begins, table, neighbour_counts, beyond):
        k = np.int32(cuda.grid(1))
        particles, there = extent(neighbour_counts)
        if k < there:
            p = load_quad(position, k)
            neighbour_counts[k], _ = search(
                k, p, position, record[0], keys[k], numbers, begins, table, particles, beyond, None
            )

    def prepare(
        position, record, keys, numbers, begins, table, neighbour_counts, beyond, factors, multipliers, constraints,
        gradients, fluids, bodies, integers, counter, place, substeps, substep, into,
    ):  # fmt: skip
        k = np.int32(cuda.grid(1))
        particles, there = extent(neighbour_counts)
        if k < there:
            parameters, p = record[0], load_quad(position, k)
            count, (gx, gy, gz, squares, total) = search_and_sum(
                k, p, position, parameters, keys[k], numbers, begins, table, particles, beyond, weights_of(fluids)
            )
            neighbour_counts[k] = count
            _, number = clock(counter, place, substeps, substep)
            wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), number)
            factor = factor_of(p, (gx, gy, gz, squares), wall, fluids, parameters)
            factors[k] = factor
            delta = relax(k, total, wall[0], factor, multipliers, constraints, parameters, True)
            store_quad(into, k, p[0], p[1], p[2], delta)

    return make_kernels((find, prepare), f"fluid_{variant_name(*variant, repeats)}", **kernel_options(math))


def _make_walking(real: Real, math: str, parts: frozenset[str], repeats: frozenset[str]) -> SimpleNamespace:
    """Compile `factors`, `density` and `correct`."""
    variant, extent, zero = (real, math, parts), make_extent(parts), real(0)
    sums, clock = make_sums(*variant, repeats), make_clock(math, parts)
    relax, move, wall_terms = make_relax(*variant), make_move(*variant, repeats), make_wall_terms(*variant)
    sum_factor, sum_density = sums.sum_factor, sums.sum_density

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
            multipliers[k] = zero

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

    name = f"fluid_{variant_name(*variant, repeats)}"
    return make_kernels((factors, density, correct), name, **walk_options(real, math))
