"""Executor of position-based constraints on CPU threads, colour by colour.

Corners, values and multipliers are arrays with one row per constraint; model/formulas/constraints has the projections.
No two runs of a colour move the same particle, so threads may process any runs of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.tuples import each_of, tuple_of
from softlab.model.base.types import Real
from softlab.model.particles.constraints import ConstraintSet, Projection

ALONE = 256  # constraints of a colour that one thread processes faster than threads can synchronise: a few microseconds
# Runs of a colour that are interleaved: the processor starts the constraint of the next run before it has finished the
# last one's. Constraints of one run depend on each other and cannot overlap.
TOGETHER = 16
SetArrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def set_arrays(constraint_set: ConstraintSet, projection: Projection, real: Real) -> SetArrays:
    """Return (corners, values, multipliers, starts) of a set, the arguments of kernels."""
    rows = len(constraint_set.corners) if projection.soft else 0
    return (
        np.ascontiguousarray(constraint_set.corners, np.int32),
        np.ascontiguousarray(constraint_set.values, real),
        np.zeros((rows, projection.multipliers), real),
        constraint_set.starts.astype(np.int32),
    )


def no_sets(real: Real) -> tuple[SetArrays, ...]:
    """Return empty sets, for a scene without constraints."""
    empty: np.ndarray = np.zeros((0, 1), real)
    return ((np.zeros((0, 2), np.int32), empty, empty, np.zeros(1, np.int32)),)


def make_rows(compiler: Compiler) -> SimpleNamespace:
    """Make accessors of particles stored as rows x, y, z, weight; `weights` is not used.

    `point(position, weights, k)`, `weight(...)`, `put(position, weights, k, point)`.
    """

    @compiler.compiled
    def point(position, weights, k):
        return position[k, 0], position[k, 1], position[k, 2]

    @compiler.compiled
    def weight(position, weights, k):
        return position[k, 3]

    @compiler.compiled
    def put(position, weights, k, point):
        position[k, 0], position[k, 1], position[k, 2] = point

    return SimpleNamespace(point=point, weight=weight, put=put)


def make_planes(compiler: Compiler) -> SimpleNamespace:
    """Make the same accessors of particles stored in three planes, each as long as `weights`."""

    @compiler.compiled
    def point(position, weights, k):
        count = weights.size
        return position[k], position[count + k], position[2 * count + k]

    @compiler.compiled
    def weight(position, weights, k):
        return weights[k]

    @compiler.compiled
    def put(position, weights, k, point):
        count = weights.size
        position[k], position[count + k], position[2 * count + k] = point

    return SimpleNamespace(point=point, weight=weight, put=put)


def make_projections(compiler: Compiler, real: Real, projection: Projection, particles: SimpleNamespace) -> Callable:
    """Make project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters).

    It projects the constraints `first` to before `last`. `multipliers` (constraints, n) count as 0 if `fresh`;
    `particles`: make_rows or make_planes.
    """
    compiled = compiler.compiled
    # inlined: a call would pass dozens of numbers through memory
    one = compiler.inlined(compiler.formulas(projection.formulas, real, dict(projection.flags)).project.py_func)
    point, weight, put = particles.point, particles.weight, particles.put
    is_soft, is_damped = projection.soft, projection.damped
    run, together = projection.run, projection.run * TOGETHER if projection.run > 1 else 1 << 30
    zero, neutral = real(0), real(1)
    has_constants = projection.constants is not None
    c_compliance, c_damping, c_stiffening = projection.constants or ("", "", "")

    def point_at(n: int) -> Callable:
        return compiled(lambda position, weights, corners, k: point(position, weights, corners[k, n]))

    def weight_at(n: int) -> Callable:
        return compiled(lambda position, weights, corners, k: weight(position, weights, corners[k, n]))

    def put_at(n: int) -> Callable:
        @compiled
        def put_one(position, weights, corners, k, moved):
            put(position, weights, corners[k, n], moved)

        return put_one

    def value_at(n: int) -> Callable:
        return compiled(lambda values, fresh, unused, k: values[k, n])

    def multiplier_at(n: int) -> Callable:
        @compiled
        def multiplier(multipliers, fresh, unused, k):
            if is_soft and not fresh:
                return multipliers[k, n]
            return zero

        return multiplier

    def store_at(n: int) -> Callable:
        @compiled
        def store(multipliers, fresh, unused, k, multiplier):
            multipliers[k, n] = multiplier

        return store

    points_of = tuple_of(projection.corners, point_at, compiled)
    weights_of = tuple_of(projection.corners, weight_at, compiled)
    values_of = tuple_of(projection.values, value_at, compiled)
    multipliers_of = tuple_of(projection.multipliers, multiplier_at, compiled)
    put_all, store_all = (
        each_of(projection.moved, put_at, compiled),
        each_of(projection.multipliers, store_at, compiled),
    )

    @compiled
    def project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters):
        constants = zero, zero, neutral
        if has_constants:
            constants = parameters[c_compliance], parameters[c_damping], parameters[c_stiffening]
        for block in range(first, last, together):
            for member in range(run):
                for k in range(block + member, min(block + together, last), run):
                    points = points_of(position, weights, corners, k)
                    old = points_of(before, weights, corners, k) if is_damped else points
                    so_far = multipliers_of(multipliers, fresh, values, k)
                    moved, total = one(
                        points, old, weights_of(position, weights, corners, k), values_of(values, fresh, values, k),
                        so_far, constants,
                    )  # fmt: skip
                    put_all(position, weights, corners, k, moved)
                    if is_soft:
                        store_all(multipliers, fresh, values, k, total)

    return project


def make_colours(compiler: Compiler, projects: Sequence[Any], runs: Sequence[int]) -> Any:
    """Make sweep(team, member, bands, position, weights, before, sets, fresh, parameters).

    It projects all constraints once, set by set and colour by colour. `projects`: make_projections of each set; `runs`:
    of each; `sets`: their set_arrays, at least one.
    """
    sweep: Any = None
    for number in range(len(projects) - 1, -1, -1):
        sweep = _of_set(compiler, number, projects[number], runs[number], sweep)
    return sweep


def _of_set(compiler: Compiler, number: int, project: Callable, run: int, others: Callable) -> Callable:
    """Make the sweep of set `number`, followed by the `others`."""
    has_others = others is not None

    @compiler.compiled
    def sweep(team, member, bands, position, weights, before, sets, fresh, parameters):
        corners, values, multipliers, starts = sets[number]
        for colour in range(starts.size - 1):
            start, runs = np.int64(starts[colour]), (starts[colour + 1] - starts[colour]) // run
            parts = bands if runs * run >= ALONE else 1
            for part in assigned(team, member, parts):
                first, last = start + run * (runs * part // parts), start + run * (runs * (part + 1) // parts)
                project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters)
        if has_others:
            others(team, member, bands, position, weights, before, sets, fresh, parameters)

    return sweep


@cache
def make_constraint_stage(real: Real, math: str, projection: Projection, in_planes: bool) -> Callable:
    """Compile stage(bands, colour, position, weights, before, constraints, fresh, parameters): a parallel loop over one
    colour, (start, stop). `constraints`: (corners, values, multipliers)."""
    run = projection.run
    compiler = Compiler(f"{projection.name}_{np.dtype(real).name}_{math}", math)
    project = make_projections(compiler, real, projection, (make_planes if in_planes else make_rows)(compiler))

    def stage(band, bands, colour, position, weights, before, constraints, fresh, parameters):
        (start, stop), (corners, values, multipliers) = colour, constraints
        runs = (stop - start) // run
        first, last = start + run * (runs * band // bands), start + run * (runs * (band + 1) // bands)
        project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters)

    return compiler.banded(stage)


@cache
def make_sweep_stage(real: Real, math: str, projections: tuple[Projection, ...]) -> Callable:
    """Compile stage(bands, position, weights, before, sets, fresh, parameters): all constraints once, in one call.

    Particles are rows; `sets`: those of the `projections`, at least one.
    """
    compiler = Compiler(f"sweep_{np.dtype(real).name}_{math}", math)
    rows = make_rows(compiler)
    projects = [make_projections(compiler, real, projection, rows) for projection in projections]
    sweep = make_colours(compiler, projects, [projection.run for projection in projections])
    return compiler.team(sweep)
