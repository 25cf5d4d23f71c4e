"""CUDA kernels of a fluid with samples of solids among its particles, one thread each (model/fluid/plan.py, Solids).

`number`: of each particle in the order of cells; `fluids`: number of the fluid's particles, samples are behind them;
`kinds`: rows of model/fluid/among_solids.py, by number. `before`, `position` of solids: quads.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import collide
from softlab.gpu_backend.core.compile import kernels_of, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.integers import clock
from softlab.gpu_backend.core.quads import AXES, SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.kernels import relax, wall_at, wall_terms
from softlab.gpu_backend.fluid.sums import List, pair, row
from softlab.gpu_backend.fluid.variants import fluid_variant
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, inlined_routine, routine
from softlab.model.fluid.among_solids import K_GRIP, K_LIGHTNESS, K_VOLUME
from softlab.model.fluid.parameters import F_VISCOSITY, F_WEIGHT
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid.density import (
    closeness,
    correction_added,
    crowded,
    gradient_added,
    moved,
    near,
    slope,
    squared,
    squares_added,
    wall_added,
)
from softlab.model.formulas.fluid.density import factor as factor_of
from softlab.model.formulas.fluid.solids import both as both_by_volumes
from softlab.model.formulas.fluid.solids import (
    carried,
    carried_on,
    counted,
    counted_slope,
    middle,
    rub,
    rub_added,
)


@inlined_routine
def point(s, corners, weights, quads):
    """Return the position of sample s among its corners, the `quads` of solids' particles."""
    at = np.int32(s * CORNERS)
    p, q, r = load_quad(quads, corners[at]), load_quad(quads, corners[at + 1]), load_quad(quads, corners[at + 2])
    a, b, c = weights[at], weights[at + 1], weights[at + 2]
    return middle(p[0], q[0], r[0], a, b, c), middle(p[1], q[1], r[1], a, b, c), middle(p[2], q[2], r[2], a, b, c)


@routine
def sample(number, fluids, corners, weights, began, solid, predicted, before, predicted_velocity):
    k = np.int32(cuda.grid(1))
    if k < number.size and number[k] >= fluids:
        s, old = np.int32(number[k] - fluids), load_quad(predicted, k)
        x, y, z = point(s, corners, weights, solid)
        store_quad(predicted, k, x, y, z, old[3])
        x, y, z = point(s, corners, weights, began)
        store_quad(before, k, x, y, z, old[3])
        store_quad(predicted_velocity, k, 0.0, 0.0, 0.0, 0.0)


@routine
def gather(number, fluids, slots):
    k = np.int32(cuda.grid(1))
    if k < number.size and number[k] >= fluids:
        slots[number[k] - fluids] = k


@routine
def follow(slots, corners, weights, solid, position):
    s = np.int32(cuda.grid(1))
    if s < slots.size:
        x, y, z = point(s, corners, weights, solid)
        store_quad(position, slots[s], x, y, z, load_quad(position, slots[s])[3])


@routine
def push(lightness, offsets, samples, weights, shift, solid):
    k = np.int32(cuda.grid(1))
    if k < lightness.size:
        x, y, z = 0.0, 0.0, 0.0
        for e in range(offsets[k], offsets[k + 1]):
            at, weight = np.int32(samples[e] * AXES), weights[e]
            x, y = carried_on(x, weight, shift[at]), carried_on(y, weight, shift[at + 1])
            z = carried_on(z, weight, shift[at + 2])
        p, light = load_quad(solid, k), lightness[k]
        store_quad(solid, k, moved(p[0], light, x), moved(p[1], light, y), moved(p[2], light, z), p[3])


@inlined_routine
def sum_factor(k, p, position, near_by, number, kinds, parameters):
    gx, gy, gz, squares, at = 0.0, 0.0, 0.0, 0.0, np.int64(k)
    for _ in range(near_by.count):
        j = near_by.table[at]
        at += near_by.particles
        dx, dy, dz, r = pair(k, p, j, load_quad(position, j), parameters)
        bare, n = slope(r, parameters.inverse_support, parameters.gradient_scale), np.int32(number[j])
        volume, light = kinds[K_VOLUME * number.size + n], kinds[K_LIGHTNESS * number.size + n]
        s = counted_slope(volume, bare)
        gx, gy, gz = gradient_added(gx, s, dx), gradient_added(gy, s, dy), gradient_added(gz, s, dz)
        squares = squares_added(squares, carried(light, volume), bare, r)
    return gx, gy, gz, squares


@inlined_routine
def sum_density(k, p, position, near_by, number, kinds, parameters):
    total, at = 0.0, np.int64(k)
    for _ in range(near_by.count):
        j = near_by.table[at]
        at += near_by.particles
        q = load_quad(position, j)
        t = closeness(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), parameters.inverse_support)
        total = counted(total, kinds[K_VOLUME * number.size + number[j]], t)
    return total


@inlined_routine
def sum_correction(k, p, position, near_by, number, kinds, parameters):
    x, y, z, at, particle = 0.0, 0.0, 0.0, np.int64(k), np.int32(number[k])
    volume, grip = kinds[K_VOLUME * number.size + particle], kinds[K_GRIP * number.size + particle]
    for _ in range(near_by.count):
        j = near_by.table[at]
        at += near_by.particles
        q, n = load_quad(position, j), np.int32(number[j])
        dx, dy, dz, r = pair(k, p, j, q, parameters)
        s = slope(r, parameters.inverse_support, parameters.gradient_scale)
        both = both_by_volumes(p[3], q[3], volume, kinds[K_VOLUME * number.size + n])
        if FEATURE.tensile:
            t = near(r, parameters.inverse_support)
            alone = kinds[K_GRIP * number.size + n] + grip == 0.0
            both = both - (crowded(t, parameters.inverse_tensile, parameters.tensile) if alone else 0.0)
        x, y = correction_added(x, both, s, dx), correction_added(y, both, s, dy)
        z = correction_added(z, both, s, dz)
    return x, y, z


@inlined_routine
def sum_friction(k, quads, position, before, near_by, number, kinds, fluids, parameters, sums):
    (p, b), (x, y, z) = quads, sums
    at, particle = np.int64(k), np.int32(number[k])
    grip, light = kinds[K_GRIP * number.size + particle], kinds[K_LIGHTNESS * number.size + particle]
    viscosity_here, wx, wy, wz = fluids[row(b[3]) + F_VISCOSITY], p[0] - b[0], p[1] - b[1], p[2] - b[2]
    for _ in range(near_by.count):
        j = near_by.table[at]
        at += near_by.particles
        n = np.int32(number[j])
        its_grip = kinds[K_GRIP * number.size + n]
        if (grip > 0.0) != (its_grip > 0.0):
            q, c = load_quad(position, j), load_quad(before, j)
            t = near(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), parameters.inverse_support)
            its_light = kinds[K_LIGHTNESS * number.size + n]
            friction = rub(t, viscosity_here, fluids[row(c[3]) + F_VISCOSITY], light, its_light, grip, its_grip)
            x, y = rub_added(x, friction, wx, q[0] - c[0]), rub_added(y, friction, wy, q[1] - c[1])
            z = rub_added(z, friction, wz, q[2] - c[2])
    return x, y, z


@routine
def factors(
    position, record, table, neighbour_counts, number, fluids, kinds, factors_, multipliers, constraints, gradients,
    rows, bodies, integers, counter, place, substeps, substep,
):  # fmt: skip
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        factors_[k], multipliers[k] = 0.0, 0.0
        if number[k] < fluids:
            parameters, p = record[0], load_quad(position, k)
            _, moment = clock(counter, place, substeps, substep)
            wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), moment)
            gx, gy, gz, squares = sum_factor(
                k, p, position, List(table, neighbour_counts[k], particles), number, kinds, parameters
            )
            weight = rows[row(p[3]) + F_WEIGHT]
            factors_[k] = factor_of(
                parameters.relaxation, weight, gx, gy, gz, squares, wall[1], wall[2], wall[3], parameters.softness
            )


@routine
def density(
    position, record, table, neighbour_counts, number, fluids, kinds, factors, multipliers, constraints, gradients,
    bodies, integers, counter, place, substeps, substep,
):  # fmt: skip
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        delta = 0.0
        if number[k] < fluids:
            parameters, p = record[0], load_quad(position, k)
            _, moment = clock(counter, place, substeps, substep)
            wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), moment)
            total = sum_density(k, p, position, List(table, neighbour_counts[k], particles), number, kinds, parameters)
            delta = relax(k, total, wall[0], factors[k], multipliers, constraints, parameters, False)
        elif FEATURE.drag:
            constraints[k] = 0.0
        position[SIZE * np.int64(k) + 3] = delta  # not read by any thread of this launch


@routine
def correct(
    before, position, record, table, neighbour_counts, number, fluids, kinds, gradients, rows, bodies, integers,
    counter, place, substeps, substep, shift, into,
):  # fmt: skip
    k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
    if k < particles:
        p, b, near_by = load_quad(position, k), load_quad(before, k), List(table, neighbour_counts[k], particles)
        parameters = record[0]
        x, y, z = sum_correction(k, p, position, near_by, number, kinds, parameters)
        if FEATURE.viscosity:
            x, y, z = sum_friction(k, (p, b), position, before, near_by, number, kinds, rows, parameters, (x, y, z))
        if number[k] >= fluids:
            at = np.int64(number[k] - fluids) * AXES
            shift[at], shift[at + 1], shift[at + 2] = x, y, z
            x, y, z = p[0], p[1], p[2]
        else:
            if FEATURE.walls:
                wall = wall_at(k, gradients)
                x, y, z = wall_added(x, p[3], wall[1]), wall_added(y, p[3], wall[2]), wall_added(z, p[3], wall[3])
            weight = rows[row(b[3]) + F_WEIGHT]
            x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
            _, moment = clock(counter, place, substeps, substep)
            x, y, z, _, _, _ = collide(b, x, y, z, 0.0, 0.0, 0.0, World(parameters, bodies, integers), moment)
        store_quad(into, k, x, y, z, b[3])


@cache
def make_sampling(real: Real, math: str) -> SimpleNamespace:
    """Compile `sample`, `gather`, `follow` and `push`.

    `sample(number, fluids, corners, weights, began, solid, predicted, before, predicted_velocity)`; `gather(number,
    fluids, slots)`; `follow(slots, corners, weights, solid, position)`; `push(lightness, offsets, samples, weights,
    shift, solid)`.
    """
    kernels = sample, gather, follow, push
    return kernels_of(device_variant(real, math), math, kernels, f"fluid_solids_{variant_name(real, math)}")


@cache
def make_solid_kernels(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `factors`, `density` and `correct`.

    `factors(position, record, table, found, number, fluids, kinds, *relaxed, rows, *world)`; `density(position, record,
    table, found, number, fluids, kinds, *relaxed, *world)`; `correct(before, position, record, table, found, number,
    fluids, kinds, gradients, rows, *world, shift, into)`. `rows`: of fluids; `relaxed`, `world`: as in
    gpu_backend/fluid/kernels.py; `shift` (samples, 3): shift of each sample.
    """
    variant = fluid_variant(real, math, parts)
    return kernels_of(variant, math, (factors, density, correct), f"fluid_solids_{variant_name(real, math, parts)}")
