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
from types import SimpleNamespace

import numpy as np
from numba import cuda

from softlab.gpu_backend.core.compile import Kernel, inlined, kernel_options, make_kernel, variant_name
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, make_row, pack, store_quad
from softlab.model.base.tuples import each_of, tuple_of
from softlab.model.base.types import Real
from softlab.model.particles.constraints import ConstraintSet, Projection


def places(constraint_set: ConstraintSet) -> np.ndarray:
    """Return (constraints,) int64: the number of the set's constraint at each place on the device."""
    return np.concatenate([np.zeros(0, np.int64), *constraint_set.sweep])


def device_corners(projection: Projection, corners: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return corners (constraints, n) int32 as `make_run` reads them.

    Groups of runs begin at `starts` (groups + 1,); in each group the first constraints of all runs come before the
    second ones.
    """
    if not projection.around:
        return pack(corners)
    run = projection.run
    groups = [corners[first:last].reshape(run, -1, projection.corners) for first, last in pairwise(starts)]
    whole = np.concatenate(groups, axis=1)
    return np.concatenate([whole[:-1, :, 0].T.ravel(), whole[-1].ravel()])


@cache
def make_projections(real: Real, math: str, projection: Projection) -> Kernel:
    """Compile project(position, before, corners, values, multipliers, start, stop, count, fresh, record).

    It projects the colour from place `start` to before `stop` of a set of `count` constraints; positions are quads with
    the particles' weights. `multipliers` count as 0 if `fresh`.
    """
    of_run, constants_of = make_run(real, math, projection), make_constants(real, math, projection)
    fetch, take, run = of_run.fetch, of_run.take, np.int32(projection.run)

    def project(position, before, corners, values, multipliers, start, stop, size, fresh, record):
        parameters = record[0]
        runs, thread, count = np.int32((stop - start) // run), np.int32(cuda.grid(1)), np.int32(size)
        if thread < runs:
            constants, place = constants_of(parameters), np.int32(start + thread)
            fetched = fetch(corners, values, np.int32(start // run + thread), place, count)
            take(position, before, (corners, values, multipliers), fetched, place, runs, count, fresh, constants)

    return make_kernel(project, f"{projection.name}_{variant_name(real, math)}", **kernel_options(math))


@cache
def make_constants(real: Real, math: str, projection: Projection) -> Callable:
    """Make constants_of(parameters): compliance, damping and stiffening for the projection."""
    has_constants, zero, neutral = projection.constants is not None, real(0), real(1)
    c_compliance, c_damping, c_stiffening = projection.constants or ("", "", "")

    @inlined(math)
    def constants_of(parameters):
        if has_constants:
            return parameters[c_compliance], parameters[c_damping], parameters[c_stiffening]
        return zero, zero, neutral

    return constants_of


@cache
def make_run(real: Real, math: str, projection: Projection) -> SimpleNamespace:
    """Make `fetch` and `take`, for run `number` of a set of `count` constraints, which begin at `place`, `apart` from
    another.

    `fetch(corners, values, number, place, count)`: constant data of its first constraint. `take(position, before,
    (corners, values, multipliers), fetched, place, apart, count, fresh, constants)`: project the run; `corners` are quads
    of `position` and `before`.
    """
    return (_make_around if projection.around else _make_apart)(real, math, projection)


def _make_apart(real: Real, math: str, projection: Projection) -> SimpleNamespace:
    functions, run, inline = make_one(real, math, projection), projection.run, inlined(math)
    corners_of, values_of, quads_of, one, put_all = (
        functions.corners_of, functions.values_of, functions.quads_of, functions.one, functions.put_all
    )  # fmt: skip

    @inline
    def fetch(corners, values, number, place, count):
        return corners_of(corners, count, place), values_of(values, count, place)

    @inline
    def take(position, before, arrays, fetched, place, apart, count, fresh, constants):
        (ends, constants_now), (corners, values, multipliers) = fetched, arrays
        if run == 1:
            quads = quads_of(position, ends, count, place)
            moved = one(before, multipliers, ends, quads, constants_now, count, place, fresh, constants)
            put_all(position, ends, count, place, moved)
        else:
            for member in range(np.int32(run)):
                here, these, those = place, ends, constants_now
                quads = quads_of(position, these, count, here)
                if member + 1 < run:
                    place = np.int32(place + apart)
                ends = corners_of(corners, count, place)  # the next one's data is loaded while this is projected
                constants_now = values_of(values, count, place)
                moved = one(before, multipliers, these, quads, those, count, here, fresh, constants)
                put_all(position, these, count, here, moved)

    return SimpleNamespace(fetch=fetch, take=take)


def _make_around(real: Real, math: str, projection: Projection) -> SimpleNamespace:
    """Make `fetch` and `take` of constraints around a run's last one.

    In turn a constraint has its own corner `a` and the corners `f`, `g`, `h` of the last one, whose fourth is `e`: they
    are at x, p, q, r and s.
    """
    functions, run, inline = make_one(real, math, projection), np.int32(projection.run), inlined(math)
    values_of, one, last = functions.values_of, functions.one, np.int32(projection.run - 1)

    @inline
    def fetch(corners, values, number, place, count):
        ends = load_quad(corners, number)
        return ends, load_quad(corners, np.int32(count // run + number)), values_of(values, count, place)

    @inline
    def take(position, before, arrays, fetched, place, apart, count, fresh, constants):
        (a, b, c, d), (e, f, g, h), ends = fetched
        _, values, multipliers = arrays
        first, second, third, fourth = e, f, g, h
        x, p, q = load_quad(position, a), load_quad(position, f), load_quad(position, g)
        r, s = load_quad(position, h), load_quad(position, e)
        for member in range(run):
            here, those = place, ends
            if member < last:
                place = np.int32(place + apart)
            ends = values_of(values, count, place)  # the next one's data is loaded while this one is projected
            coming = load_quad(position, b)
            x, p, q, r = one(before, multipliers, (a, f, g, h), (x, p, q, r), those, count, here, fresh, constants)
            store_quad(position, a, x[0], x[1], x[2], x[3])
            a, b, c, d, e, f, g, h = b, c, d, first, f, g, h, e
            x, p, q, r, s = coming if member + 1 < last else p, q, r, s, p
        store_quad(position, second, s[0], s[1], s[2], s[3])
        store_quad(position, third, p[0], p[1], p[2], p[3])
        store_quad(position, fourth, q[0], q[1], q[2], q[3])

    return SimpleNamespace(fetch=fetch, take=take)


@cache
def make_one(real: Real, math: str, projection: Projection) -> SimpleNamespace:
    """Make the functions of one constraint at a place of a set of `count`.

    `corners_of(corners, count, place)`, `values_of(values, ...)`: its constant data; `quads_of(position, ends, ...)`:
    its particles, `ends` being its corners; `one(before, multipliers, ends, quads, values, count, place, fresh,
    constants)`: the particles that its projection moves; `put_all(position, ends, count, place, quads)`: store these.
    """
    project = device_formulas(projection.formulas, real, math, dict(projection.flags)).project
    inline, is_soft, is_damped = inlined(math), projection.soft, projection.damped
    zero = real(0)

    def quad_at(n: int) -> Callable:
        return inline(lambda position, ends, count, k: load_quad(position, ends[n]))

    def put_at(n: int) -> Callable:
        @inline
        def put(position, ends, count, k, quad):
            store_quad(position, ends[n], quad[0], quad[1], quad[2], quad[3])

        return put

    def point_at(n: int) -> Callable:
        return inline(lambda quads, count, unused, k: (quads[n][0], quads[n][1], quads[n][2]))

    def weight_at(n: int) -> Callable:
        return inline(lambda quads, count, unused, k: quads[n][3])

    def moved_at(n: int) -> Callable:
        return inline(lambda points, quads, unused, k: (points[n][0], points[n][1], points[n][2], quads[n][3]))

    def multiplier_at(n: int) -> Callable:
        @inline
        def multiplier(multipliers, fresh, count, k):
            if is_soft:
                if not fresh:
                    return multipliers[np.uint32(np.int32(n * count) + k)]
            return zero

        return multiplier

    def store_at(n: int) -> Callable:
        @inline
        def store(multipliers, fresh, count, k, multiplier):
            multipliers[np.uint32(np.int32(n * count) + k)] = multiplier

        return store

    corners_of, values_of = make_row(projection.corners, inline), make_row(projection.values, inline)
    quads_of, points_of, weights_of = (
        tuple_of(projection.corners, item, inline) for item in (quad_at, point_at, weight_at)
    )
    multipliers_of = tuple_of(projection.multipliers, multiplier_at, inline)
    moved_of, put_all = (
        tuple_of(projection.moved, moved_at, inline),
        each_of(projection.moved, put_at, inline),
    )
    store_all = each_of(projection.multipliers, store_at, inline)

    @inline
    def one(before, multipliers, ends, quads, values, count, k, fresh, constants):
        points = points_of(quads, count, count, k)
        old = points
        if is_damped:
            old = points_of(quads_of(before, ends, count, k), count, count, k)
        moved, total = project(
            points, old, weights_of(quads, count, count, k), values, multipliers_of(multipliers, fresh, count, k),
            constants,
        )  # fmt: skip
        if is_soft:
            store_all(multipliers, fresh, count, k, total)
        return moved_of(moved, quads, count, k)

    return SimpleNamespace(corners_of=corners_of, values_of=values_of, quads_of=quads_of, one=one, put_all=put_all)
