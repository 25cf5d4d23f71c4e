"""CUDA kernels of a fluid with samples of solids among its particles, one thread each (model/fluid/plan.py, Solids).

`number`: of each particle in the order of cells; `fluids`: number of the fluid's particles, samples are behind them;
`kinds`: rows of model/fluid/among_solids.py, by number. `before`, `position` of solids: quads.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.contact.colliders import make_collide
from softlab.gpu_backend.core.compile import inlined, kernel_options, make_kernels, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.integers import make_clock
from softlab.gpu_backend.core.quads import SIZE, load_quad, store_quad
from softlab.gpu_backend.core.world import World
from softlab.gpu_backend.fluid.kernels import WALL, make_relax, make_wall_terms
from softlab.gpu_backend.fluid.sums import List, make_row
from softlab.model.base.types import Real
from softlab.model.fluid.among_solids import K_GRIP, K_LIGHTNESS, K_VOLUME
from softlab.model.fluid.parameters import F_VISCOSITY, F_WEIGHT
from softlab.model.fluid.samples import CORNERS
from softlab.model.formulas.fluid import density, solids


@cache
def make_sampling(real: Real, math: str) -> SimpleNamespace:
    """Compile `sample`, `gather`, `follow` and `push`.

    `sample(number, fluids, corners, weights, began, solid, predicted, before, predicted_velocity)`; `gather(number,
    fluids, slots)`; `follow(slots, corners, weights, solid, position)`; `push(lightness, offsets, samples, weights,
    shift, solid)`.
    """
    formulas, inline = device_formulas(solids, real, math), inlined(math)
    middle, carried_on, moved = formulas.middle, formulas.carried_on, device_formulas(density, real, math).moved
    zero, corners_each, axes = real(0), np.int32(CORNERS), np.int32(3)

    @inline
    def point(s, corners, weights, quads):
        at = np.int32(s * corners_each)
        p, q, r = load_quad(quads, corners[at]), load_quad(quads, corners[at + 1]), load_quad(quads, corners[at + 2])
        a, b, c = weights[at], weights[at + 1], weights[at + 2]
        return middle(p[0], q[0], r[0], a, b, c), middle(p[1], q[1], r[1], a, b, c), middle(p[2], q[2], r[2], a, b, c)

    def sample(number, fluids, corners, weights, began, solid, predicted, before, predicted_velocity):
        k = np.int32(cuda.grid(1))
        if k < number.size and number[k] >= fluids:
            s, old = np.int32(number[k] - fluids), load_quad(predicted, k)
            x, y, z = point(s, corners, weights, solid)
            store_quad(predicted, k, x, y, z, old[3])
            x, y, z = point(s, corners, weights, began)
            store_quad(before, k, x, y, z, old[3])
            store_quad(predicted_velocity, k, zero, zero, zero, zero)

    def gather(number, fluids, slots):
        k = np.int32(cuda.grid(1))
        if k < number.size and number[k] >= fluids:
            slots[number[k] - fluids] = k

    def follow(slots, corners, weights, solid, position):
        s = np.int32(cuda.grid(1))
        if s < slots.size:
            x, y, z = point(s, corners, weights, solid)
            store_quad(position, slots[s], x, y, z, load_quad(position, slots[s])[3])

    def push(lightness, offsets, samples, weights, shift, solid):
        k = np.int32(cuda.grid(1))
        if k < lightness.size:
            x, y, z = zero, zero, zero
            for e in range(offsets[k], offsets[k + 1]):
                at, weight = np.int32(samples[e] * axes), weights[e]
                x, y = carried_on(x, weight, shift[at]), carried_on(y, weight, shift[at + 1])
                z = carried_on(z, weight, shift[at + 2])
            p, light = load_quad(solid, k), lightness[k]
            store_quad(solid, k, moved(p[0], light, x), moved(p[1], light, y), moved(p[2], light, z), p[3])

    kernels = sample, gather, follow, push
    return make_kernels(kernels, f"fluid_solids_{variant_name(real, math)}", **kernel_options(math))


@cache
def _make_solid_sums(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Make sums over the list of particle k at p (a quad): `sum_factor`, `sum_density`, `sum_correction`,
    `sum_friction`."""
    f, s_ = device_formulas(density, real, math), device_formulas(solids, real, math)
    squared, apart, near, closeness, slope = f.squared, f.apart, f.near, f.closeness, f.slope
    inline = inlined(math)
    gradient_added, squares_added, crowded, correction_added = (
        f.gradient_added,
        f.squares_added,
        f.crowded,
        f.correction_added,
    )
    counted, counted_slope, carried, both_of = s_.counted, s_.counted_slope, s_.carried, s_.both
    rub, rub_added, row, zero = s_.rub, s_.rub_added, make_row(parts), real(0)
    volume_row, grip_row, light_row = np.int32(K_VOLUME), np.int32(K_GRIP), np.int32(K_LIGHTNESS)
    is_tensile, viscosity = "tensile" in parts, np.int32(F_VISCOSITY)

    @inline
    def pair(k, p, j, q, parameters):
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        dy = apart(dy, squared(dx, dy, dz), parameters.support, k < j)
        return dx, dy, dz, squared(dx, dy, dz)

    @inline
    def sum_factor(k, p, position, near_by, number, kinds, parameters):
        gx, gy, gz, squares, at = zero, zero, zero, zero, np.int64(k)
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            dx, dy, dz, r = pair(k, p, j, load_quad(position, j), parameters)
            bare, n = slope(r, parameters.inverse_support, parameters.gradient_scale), np.int32(number[j])
            volume, light = kinds[volume_row * number.size + n], kinds[light_row * number.size + n]
            s = counted_slope(volume, bare)
            gx, gy, gz = gradient_added(gx, s, dx), gradient_added(gy, s, dy), gradient_added(gz, s, dz)
            squares = squares_added(squares, carried(light, volume), bare, r)
        return gx, gy, gz, squares

    @inline
    def sum_density(k, p, position, near_by, number, kinds, parameters):
        total, at = zero, np.int64(k)
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            q = load_quad(position, j)
            t = closeness(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), parameters.inverse_support)
            total = counted(total, kinds[volume_row * number.size + number[j]], t)
        return total

    @inline
    def sum_correction(k, p, position, near_by, number, kinds, parameters):
        x, y, z, at, particle = zero, zero, zero, np.int64(k), np.int32(number[k])
        volume, grip = kinds[volume_row * number.size + particle], kinds[grip_row * number.size + particle]
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            q, n = load_quad(position, j), np.int32(number[j])
            dx, dy, dz, r = pair(k, p, j, q, parameters)
            s = slope(r, parameters.inverse_support, parameters.gradient_scale)
            both = both_of(p[3], q[3], volume, kinds[volume_row * number.size + n])
            if is_tensile:
                t = near(r, parameters.inverse_support)
                alone = kinds[grip_row * number.size + n] + grip == zero
                both = both - (crowded(t, parameters.inverse_tensile, parameters.tensile) if alone else zero)
            x, y = correction_added(x, both, s, dx), correction_added(y, both, s, dy)
            z = correction_added(z, both, s, dz)
        return x, y, z

    @inline
    def sum_friction(k, p, b, position, before, near_by, number, kinds, fluids, parameters, x, y, z):
        at, particle = np.int64(k), np.int32(number[k])
        grip, light = kinds[grip_row * number.size + particle], kinds[light_row * number.size + particle]
        viscosity_here, wx, wy, wz = fluids[row(b[3]) + viscosity], p[0] - b[0], p[1] - b[1], p[2] - b[2]
        for _ in range(near_by.count):
            j = near_by.table[at]
            at += near_by.particles
            n = np.int32(number[j])
            its_grip = kinds[grip_row * number.size + n]
            if (grip > zero) != (its_grip > zero):
                q, c = load_quad(position, j), load_quad(before, j)
                t = near(squared(p[0] - q[0], p[1] - q[1], p[2] - q[2]), parameters.inverse_support)
                its_light = kinds[light_row * number.size + n]
                friction = rub(t, viscosity_here, fluids[row(c[3]) + viscosity], light, its_light, grip, its_grip)
                x, y = rub_added(x, friction, wx, q[0] - c[0]), rub_added(y, friction, wy, q[1] - c[1])
                z = rub_added(z, friction, wz, q[2] - c[2])
        return x, y, z

    return SimpleNamespace(
        sum_factor=sum_factor, sum_density=sum_density, sum_correction=sum_correction, sum_friction=sum_friction
    )


@cache
def make_solid_kernels(real: Real, math: str, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `factors`, `density` and `correct`.

    `factors(position, record, table, found, number, fluids, kinds, *relaxed, rows, *world)`; `density(position, record,
    table, found, number, fluids, kinds, *relaxed, *world)`; `correct(before, position, record, table, found, number,
    fluids, kinds, gradients, rows, *world, shift, into)`. `rows`: of fluids; `relaxed`, `world`: as in
    gpu_backend/fluid/kernels.py; `shift` (samples, 3): shift of each sample.
    """
    kernels = *_make_solid_densities(real, math, parts), _make_solid_correction(real, math, parts)
    name = f"fluid_solids_{variant_name(real, math, parts)}"
    return make_kernels(kernels, name, **kernel_options(math))


def _make_solid_densities(real: Real, math: str, parts: frozenset[str]) -> tuple[Callable, Callable]:
    variant = real, math, parts
    factor_of, sums = device_formulas(density, real, math).factor, _make_solid_sums(*variant)
    relax, row, wall_terms = make_relax(*variant), make_row(parts), make_wall_terms(*variant)
    sum_factor, sum_density, clock = sums.sum_factor, sums.sum_density, make_clock(math, parts)
    keeps, zero, weight_field = "drag" in parts, real(0), np.int32(F_WEIGHT)

    def factors(
        position, record, table, neighbour_counts, number, fluids, kinds, factors_, multipliers, constraints, gradients,
        rows, bodies, integers, counter, place, substeps, substep,
    ):  # fmt: skip
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            factors_[k], multipliers[k] = zero, zero
            if number[k] < fluids:
                parameters, p = record[0], load_quad(position, k)
                _, moment = clock(counter, place, substeps, substep)
                wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), moment)
                gx, gy, gz, squares = sum_factor(
                    k, p, position, List(table, neighbour_counts[k], particles), number, kinds, parameters
                )
                weight = rows[row(p[3]) + weight_field]
                factors_[k] = factor_of(
                    parameters.relaxation, weight, gx, gy, gz, squares, wall[1], wall[2], wall[3], parameters.softness
                )

    def density_(
        position, record, table, neighbour_counts, number, fluids, kinds, factors, multipliers, constraints, gradients,
        bodies, integers, counter, place, substeps, substep,
    ):  # fmt: skip
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            delta = zero
            if number[k] < fluids:
                parameters, p = record[0], load_quad(position, k)
                _, moment = clock(counter, place, substeps, substep)
                wall = wall_terms(k, p, gradients, World(parameters, bodies, integers), moment)
                total = sum_density(
                    k, p, position, List(table, neighbour_counts[k], particles), number, kinds, parameters
                )
                delta = relax(k, total, wall[0], factors[k], multipliers, constraints, parameters, False)
            elif keeps:
                constraints[k] = zero
            position[SIZE * np.int64(k) + 3] = delta  # not read by any thread of this launch

    density_.__name__ = "density"
    return factors, density_


def _make_solid_correction(real: Real, math: str, parts: frozenset[str]) -> Callable:
    variant = real, math, parts
    f, sums, row = device_formulas(density, real, math), _make_solid_sums(*variant), make_row(parts)
    sum_correction, sum_friction, wall_added, moved = sums.sum_correction, sums.sum_friction, f.wall_added, f.moved
    clock, collide = make_clock(math, parts), make_collide(*variant)
    has_walls, rubs, zero = "walls" in parts, "viscosity" in parts, real(0)
    axes, weight_field = np.int32(WALL), np.int32(F_WEIGHT)

    def correct(
        before, position, record, table, neighbour_counts, number, fluids, kinds, gradients, rows, bodies, integers,
        counter, place, substeps, substep, shift, into,
    ):  # fmt: skip
        k, particles = np.int32(cuda.grid(1)), np.int32(neighbour_counts.size)
        if k < particles:
            p, b, near_by = load_quad(position, k), load_quad(before, k), List(table, neighbour_counts[k], particles)
            parameters = record[0]
            x, y, z = sum_correction(k, p, position, near_by, number, kinds, parameters)
            if rubs:
                x, y, z = sum_friction(
                    k, p, b, position, before, near_by, number, kinds, rows, parameters, x, y, z
                )  # fmt: skip
            if number[k] >= fluids:
                at = np.int64(number[k] - fluids) * axes
                shift[at], shift[at + 1], shift[at + 2] = x, y, z
                x, y, z = p[0], p[1], p[2]
            else:
                if has_walls:
                    at = np.int64(k) * axes
                    x, y = wall_added(x, p[3], gradients[at]), wall_added(y, p[3], gradients[at + 1])
                    z = wall_added(z, p[3], gradients[at + 2])
                weight = rows[row(b[3]) + weight_field]
                x, y, z = moved(p[0], weight, x), moved(p[1], weight, y), moved(p[2], weight, z)
                _, moment = clock(counter, place, substeps, substep)
                x, y, z, _, _, _ = collide(b, x, y, z, zero, zero, zero, World(parameters, bodies, integers), moment)
            store_quad(into, k, x, y, z, b[3])

    return correct
