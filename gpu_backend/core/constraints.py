"""Executor of position-based constraints on CUDA: one thread per run of constraints of a colour; no two runs move the
same particle.

Corners and values are packed (core/quads.py), multipliers stored column by column, and in each colour the first
constraints of all runs come before the second ones (`places`), so that neighbouring threads read neighbouring numbers;
model/formulas/constraints has the projections.

Constraints around a run's last one (Projection.around) leave its corners in registers from the first to the last: of a
voxel's five tetrahedra eight vertices are read and written once each, instead of twenty.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_variant
from softlab.gpu_backend.core.quads import load_quad, pack, row_of, store_quad
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, inlined_routine, routine, unrolled
from softlab.model.particles.constraints import ConstraintSet, Projection


def places(constraint_set: ConstraintSet) -> np.ndarray:
    """Return (constraints,) int64: the number of the set's constraint at each place on the device."""
    return np.concatenate([np.zeros(0, np.int64), *constraint_set.sweep])


def device_corners(projection: Projection, corners: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return corners (constraints, n) int32 as `fetch` reads them.

    Groups of runs begin at `starts` (groups + 1,); in each group the first constraints of all runs come before the
    second ones.
    """
    if not projection.around:
        return pack(corners)
    run = projection.run
    groups = [corners[first:last].reshape(run, -1, projection.corners) for first, last in pairwise(starts)]
    whole = np.concatenate(groups, axis=1)
    return np.concatenate([whole[:-1, :, 0].T.ravel(), whole[-1].ravel()])


corners_of = Open("corners_of(corners, count, place): `row_of` a constraint's corners")
values_of = Open("values_of(values, count, place): `row_of` a constraint's values")
project_one = Open("project_one(points, old, weights, values, multipliers, constants): of the projection's formulas")


@inlined_routine
def constants_of(parameters):
    """Return compliance, damping and stiffening for the projection."""
    if FEATURE.name_of_compliance:
        return (
            parameters[FEATURE.name_of_compliance], parameters[FEATURE.name_of_damping],
            parameters[FEATURE.name_of_stiffening],
        )  # fmt: skip
    return 0.0, 0.0, 1.0


@inlined_routine
def quads_of(position, ends):
    """Return the particles of a constraint, `ends` being its corners."""
    return tuple(load_quad(position, ends[n]) for n in unrolled(FEATURE.corners))


@inlined_routine
def points_of(quads):
    return tuple((quads[n][0], quads[n][1], quads[n][2]) for n in unrolled(FEATURE.corners))


@inlined_routine
def multiplier_at(multipliers, n, fresh, count, place):
    if FEATURE.soft:
        if not fresh:
            return multipliers[np.uint32(np.int32(n * count) + place)]
    return 0.0


@inlined_routine
def moved_quads(before, multipliers, ends, quads, values, count, place, fresh, constants):
    """Return the particles that a constraint's projection moves, and store its multipliers."""
    points = points_of(quads)
    old = points
    if FEATURE.damped:
        old = points_of(quads_of(before, ends))
    weights = tuple(quads[n][3] for n in unrolled(FEATURE.corners))
    so_far = tuple(multiplier_at(multipliers, n, fresh, count, place) for n in unrolled(FEATURE.multipliers))
    moved, total = project_one(points, old, weights, values, so_far, constants)
    if FEATURE.soft:
        for n in unrolled(FEATURE.multipliers):
            multipliers[np.uint32(np.int32(n * count) + place)] = total[n]
    return tuple((moved[n][0], moved[n][1], moved[n][2], quads[n][3]) for n in unrolled(FEATURE.moved))


@inlined_routine
def store_moved(position, ends, quads):
    for n in unrolled(FEATURE.moved):
        store_quad(position, ends[n], quads[n][0], quads[n][1], quads[n][2], quads[n][3])


@inlined_routine
def fetch(corners, values, number, place, count):
    """Return constant data of the first constraint of run `number` of a set of `count` constraints; it is at
    `place`."""
    if FEATURE.around:
        ends = load_quad(corners, number)
        last = load_quad(corners, np.int32(count // np.int32(FEATURE.run) + number))
        return ends, last, values_of(values, count, place)
    return corners_of(corners, count, place), values_of(values, count, place)


@inlined_routine
def take_apart(position, before, arrays, fetched, place, apart, count, fresh, constants):
    """Project a run whose first constraint, with the data `fetched`, is at `place`, and the others `apart` from one
    another; `arrays`: (corners, values, multipliers); `corners` are quads of `position` and `before`."""
    (ends, constants_now), (corners, values, multipliers) = fetched, arrays
    if FEATURE.run == 1:
        quads = quads_of(position, ends)
        moved = moved_quads(before, multipliers, ends, quads, constants_now, count, place, fresh, constants)
        store_moved(position, ends, moved)
    else:
        for member in range(np.int32(FEATURE.run)):
            here, these, those = place, ends, constants_now
            quads = quads_of(position, these)
            if member + 1 < FEATURE.run:
                place = np.int32(place + apart)
            ends = corners_of(corners, count, place)  # the next one's data is loaded while this is projected
            constants_now = values_of(values, count, place)
            moved = moved_quads(before, multipliers, these, quads, those, count, here, fresh, constants)
            store_moved(position, these, moved)


@inlined_routine
def take_around(position, before, arrays, fetched, place, apart, count, fresh, constants):
    """Project a run of constraints around its last one; arguments as of `take_apart`.

    In turn a constraint has its own corner `a` and the corners `f`, `g`, `h` of the last one, whose fourth is `e`: they
    are at x, p, q, r and s.
    """
    (a, b, c, d), (e, f, g, h), ends = fetched
    _, values, multipliers = arrays
    first, second, third, fourth = e, f, g, h
    x, p, q = load_quad(position, a), load_quad(position, f), load_quad(position, g)
    r, s = load_quad(position, h), load_quad(position, e)
    for member in range(np.int32(FEATURE.run)):
        here, those = place, ends
        if member < np.int32(FEATURE.run - 1):
            place = np.int32(place + apart)
        ends = values_of(values, count, place)  # the next one's data is loaded while this one is projected
        coming = load_quad(position, b)
        x, p, q, r = moved_quads(before, multipliers, (a, f, g, h), (x, p, q, r), those, count, here, fresh, constants)
        store_quad(position, a, x[0], x[1], x[2], x[3])
        a, b, c, d, e, f, g, h = b, c, d, first, f, g, h, e
        x, p, q, r, s = coming if member + 1 < np.int32(FEATURE.run - 1) else p, q, r, s, p
    store_quad(position, second, s[0], s[1], s[2], s[3])
    store_quad(position, third, p[0], p[1], p[2], p[3])
    store_quad(position, fourth, q[0], q[1], q[2], q[3])


@inlined_routine
def take(position, before, arrays, fetched, place, apart, count, fresh, constants):
    """Project a run of constraints; arguments as of `take_apart`."""
    if FEATURE.around:
        take_around(position, before, arrays, fetched, place, apart, count, fresh, constants)
    else:
        take_apart(position, before, arrays, fetched, place, apart, count, fresh, constants)


@routine
def project(position, before, corners, values, multipliers, start, stop, size, fresh, record):
    """Project the colour from place `start` to before `stop` of a set of `size` constraints; positions are quads with
    the particles' weights. `multipliers` count as 0 if `fresh`."""
    parameters = record[0]
    runs, thread, count = np.int32((stop - start) // np.int32(FEATURE.run)), np.int32(cuda.grid(1)), np.int32(size)
    if thread < runs:
        constants, place = constants_of(parameters), np.int32(start + thread)
        fetched = fetch(corners, values, np.int32(start // np.int32(FEATURE.run) + thread), place, count)
        take(position, before, (corners, values, multipliers), fetched, place, runs, count, fresh, constants)


@cache
def make_projections(real: Real, math: str, projection: Projection) -> Kernel:
    """Compile `project`."""
    kernel = device_variant(real, math, projection.features).copied(with_projection(project, math, projection))
    return make_kernel(kernel, f"{projection.name}_{variant_name(real, math)}", **kernel_options(math))


def with_projection(kernel: Callable, math: str, projection: Projection) -> Callable:
    """Return a kernel that calls `fetch` and `take` with what is open in them."""

    def row(numbers: int) -> Callable:
        return device_variant(np.float32, math, {"numbers": numbers})(row_of)

    names = {"corners_of": row(projection.corners), "values_of": row(projection.values)}
    return filled(kernel, names | {"project_one": projection.formulas.project})
