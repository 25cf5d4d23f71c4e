"""The executor of position-based constraints on CUDA: a thread for each run of constraints of a colour, no two of which move
the same particle.

Corners, values and multipliers are flat and lie column by column, of a colour the first constraints of all runs before the
second ones (`places`), so that neighbouring threads read neighbouring numbers; what a projection computes is in
model/formulas/constraints.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from gpu_backend.core.compile import inlined, kernel_options, make_kernel, variant_name
from gpu_backend.core.formulas import device_formulas
from gpu_backend.core.quads import load_quad, store_quad
from model.core.constraints import ConstraintSet, Projection
from model.core.tuples import each_of, tuple_of


def places(found: ConstraintSet) -> np.ndarray:
    """(constraints,) int64: which constraint of the set stands at each place on the device."""
    return np.concatenate([np.zeros(0, np.int64), *found.sweep])


@cache
def make_projections(real: Any, math: str, projection: Projection) -> Any:
    """project(position, before, corners, values, multipliers, start, stop, count, fresh, record): the colour from place
    `start` to before `stop` of a set of `count`; positions are quads with the particles' weights. `multipliers` count as 0
    where `fresh`."""
    take, constants_of = make_run(real, math, projection), make_constants(real, math, projection)
    run = projection.run

    def project(position, before, corners, values, multipliers, start, stop, size, fresh, record):
        parameters = record[0]
        runs, mine = np.int32((stop - start) // run), np.int32(cuda.grid(1))  # type: ignore[call-arg]
        if mine < runs:
            constants, place = constants_of(parameters), np.int32(start + mine)
            take(position, before, corners, values, multipliers, place, runs, np.int32(size), fresh, constants)

    return make_kernel(project, f"{projection.name}_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_constants(real: Any, math: str, projection: Projection) -> Any:
    """constants_of(parameters): compliance, damping and stiffening, as the projection takes them."""
    has_constants, zero, neutral = projection.constants is not None, real(0), real(1)
    c_compliance, c_damping, c_stiffening = projection.constants or ("", "", "")

    @inlined(math)
    def constants_of(parameters):
        if has_constants:
            return parameters[c_compliance], parameters[c_damping], parameters[c_stiffening]
        return zero, zero, neutral

    return constants_of


@cache
def make_run(real: Any, math: str, projection: Projection) -> Any:
    """take(position, before, corners, values, multipliers, place, apart, count, fresh, constants): a run of constraints of a
    set of `count`, from `place` on, `apart` from one another, whose `corners` are quads of `position` and `before`."""
    f, run = make_one(real, math, projection), projection.run
    corners_of, values_of, quads_of, one = f.corners_of, f.values_of, f.quads_of, f.one

    @inlined(math)
    def take(position, before, corners, values, multipliers, place, apart, count, fresh, constants):
        ends = corners_of(corners, count, count, place)
        if run == 1:
            quads = quads_of(position, ends, count, place)
            own = values_of(values, count, count, place)
            one(position, before, multipliers, ends, quads, own, count, place, fresh, constants)
        else:
            own = values_of(values, count, count, place)
            for member in range(run):
                here, these, those = place, ends, own
                quads = quads_of(position, these, count, here)
                if member + 1 < run:
                    place = np.int32(place + apart)
                ends = corners_of(corners, count, count, place)  # what the next one reads is on its way while this one
                own = values_of(values, count, count, place)  # is projected
                one(position, before, multipliers, these, quads, those, count, here, fresh, constants)

    return take


@cache
def make_one(real: Any, math: str, projection: Projection) -> SimpleNamespace:
    """Of the constraint at a place of a set of `count`: `corners_of(corners, count, count, place)`, `values_of(values, ...)`,
    what is fixed of it; `quads_of(position, ends, ...)`: its particles, `ends` being its corners; `one(position, before,
    multipliers, ends, quads, values, count, place, fresh, constants)`: its projection."""
    project = device_formulas(projection.make, real, math, **dict(projection.flags)).project
    inline, is_soft, is_damped = inlined(math), projection.soft, projection.damped
    zero = real(0)

    def corner_at(n: int) -> Any:
        return inline(lambda corners, unused, count, k: corners[n * count + k])

    def quad_at(n: int) -> Any:
        return inline(lambda position, ends, count, k: load_quad(position, ends[n]))

    def put_at(n: int) -> Any:
        @inline
        def put(position, ends, count, k, quad):
            store_quad(position, ends[n], quad[0], quad[1], quad[2], quad[3])

        return put

    def point_at(n: int) -> Any:
        return inline(lambda quads, count, unused, k: (quads[n][0], quads[n][1], quads[n][2]))

    def weight_at(n: int) -> Any:
        return inline(lambda quads, count, unused, k: quads[n][3])

    def moved_at(n: int) -> Any:
        return inline(lambda points, quads, unused, k: (points[n][0], points[n][1], points[n][2], quads[n][3]))

    def value_at(n: int) -> Any:
        return inline(lambda values, unused, count, k: values[n * count + k])

    def multiplier_at(n: int) -> Any:
        @inline
        def multiplier(multipliers, fresh, count, k):
            if is_soft:
                if not fresh:
                    return multipliers[n * count + k]
            return zero

        return multiplier

    def keep_at(n: int) -> Any:
        @inline
        def keep(multipliers, fresh, count, k, multiplier):
            multipliers[n * count + k] = multiplier

        return keep

    corners_of = tuple_of(projection.corners, corner_at, inline)
    quads_of, points_of, weights_of = (
        tuple_of(projection.corners, item, inline) for item in (quad_at, point_at, weight_at)
    )
    values_of, multipliers_of = (
        tuple_of(projection.values, value_at, inline),
        tuple_of(projection.multipliers, multiplier_at, inline),
    )
    moved_of, put_all = (
        tuple_of(projection.moved, moved_at, inline),
        each_of(projection.moved, put_at, inline),
    )
    keep_all = each_of(projection.multipliers, keep_at, inline)

    @inline
    def one(position, before, multipliers, ends, quads, values, count, k, fresh, constants):
        points = points_of(quads, count, count, k)
        old = points
        if is_damped:
            old = points_of(quads_of(before, ends, count, k), count, count, k)
        moved, total = project(
            points, old, weights_of(quads, count, count, k), values, multipliers_of(multipliers, fresh, count, k),
            constants,
        )  # fmt: skip
        put_all(position, ends, count, k, moved_of(moved, quads, count, k))
        if is_soft:
            keep_all(multipliers, fresh, count, k, total)

    return SimpleNamespace(corners_of=corners_of, values_of=values_of, quads_of=quads_of, one=one)
