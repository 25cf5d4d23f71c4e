"""Executor of position-based constraints on CPU threads, colour by colour.

Corners, values and multipliers are arrays with one row per constraint; model/formulas/constraints has the projections.
No two runs of a colour move the same particle, so threads may process any runs of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.progress import assigned
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, filled, routine, unrolled
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


project_one = Open("project_one(points, old, weights, values, multipliers, constants): of the projection's formulas")
project = Open("project(...): project_run of the set's projection")
others = Open("others(...): sweep_set of the next sets")


@routine
def point_at(position, weights, k):
    """Return particle k, stored as a row x, y, z, weight, or in FEATURE.planes as long as `weights`."""
    if FEATURE.planes:
        count = weights.size
        return position[k], position[count + k], position[2 * count + k]
    return position[k, 0], position[k, 1], position[k, 2]


@routine
def weight_at(position, weights, k):
    return weights[k] if FEATURE.planes else position[k, 3]


@routine
def put_point(position, weights, k, point):
    if FEATURE.planes:
        count = weights.size
        position[k], position[count + k], position[2 * count + k] = point
    else:
        position[k, 0], position[k, 1], position[k, 2] = point


@routine
def multiplier_at(multipliers, fresh, k, n):
    if FEATURE.soft and not fresh:
        return multipliers[k, n]
    return 0.0


@routine
def project_run(first, last, position, weights, before, corners, values, multipliers, fresh, parameters):
    """Project the constraints `first` to before `last`. `multipliers` (constraints, n) count as 0 if `fresh`."""
    constants = 0.0, 0.0, 1.0
    if FEATURE.name_of_compliance:
        constants = (
            parameters[FEATURE.name_of_compliance], parameters[FEATURE.name_of_damping],
            parameters[FEATURE.name_of_stiffening],
        )  # fmt: skip
    together = FEATURE.run * TOGETHER if FEATURE.run > 1 else 1 << 30
    for block in range(first, last, together):
        for member in range(FEATURE.run):
            for k in range(block + member, min(block + together, last), FEATURE.run):
                points = tuple(point_at(position, weights, corners[k, n]) for n in unrolled(FEATURE.corners))
                old = points
                if FEATURE.damped:
                    old = tuple(point_at(before, weights, corners[k, n]) for n in unrolled(FEATURE.corners))
                so_far = tuple(multiplier_at(multipliers, fresh, k, n) for n in unrolled(FEATURE.multipliers))
                moved, total = project_one(
                    points, old, tuple(weight_at(position, weights, corners[k, n]) for n in unrolled(FEATURE.corners)),
                    tuple(values[k, n] for n in unrolled(FEATURE.values)), so_far, constants,
                )  # fmt: skip
                for n in unrolled(FEATURE.moved):
                    put_point(position, weights, corners[k, n], moved[n])
                if FEATURE.soft:
                    for n in unrolled(FEATURE.multipliers):
                        multipliers[k, n] = total[n]


@routine
def sweep_set(team, member, bands, position, weights, before, sets, fresh, parameters):
    """Project the constraints of set FEATURE.number once, colour by colour, then those of the next sets; `sets`:
    set_arrays of each."""
    corners, values, multipliers, starts = sets[FEATURE.number]
    for colour in range(starts.size - 1):
        start, runs = np.int64(starts[colour]), (starts[colour + 1] - starts[colour]) // FEATURE.run
        parts = bands if runs * FEATURE.run >= ALONE else 1
        for part in assigned(team, member, parts):
            first = start + FEATURE.run * (runs * part // parts)
            last = start + FEATURE.run * (runs * (part + 1) // parts)
            project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters)
    if FEATURE.followed:
        others(team, member, bands, position, weights, before, sets, fresh, parameters)


@routine
def stage(band, bands, colour, position, weights, before, constraints, fresh, parameters):
    """Project a band's runs of one colour, (start, stop). `constraints`: (corners, values, multipliers)."""
    (start, stop), (corners, values, multipliers) = colour, constraints
    runs = (stop - start) // FEATURE.run
    first = start + FEATURE.run * (runs * band // bands)
    last = start + FEATURE.run * (runs * (band + 1) // bands)
    project(first, last, position, weights, before, corners, values, multipliers, fresh, parameters)


def make_projections(compiler: Compiler, real: Real, projection: Projection, in_planes: bool) -> Callable:
    """Compile `project_run` for particles in planes or in rows."""
    # inlined: a call would pass dozens of numbers through memory
    variant = compiler.variant_of(real, projection.features | {"planes": in_planes})
    one = compiler.inlined(variant.copied(projection.formulas.project))
    return variant(filled(project_run, {"project_one": one}))


def make_colours(compiler: Compiler, projects: Sequence[Callable], runs: Sequence[int]) -> Callable | None:
    """Compile sweep(team, member, bands, position, weights, before, sets, fresh, parameters).

    It projects all constraints once, set by set and colour by colour. `projects`: make_projections of each set; `runs`:
    of each; `sets`: their set_arrays. None without sets: who calls it leaves it out.
    """
    sweep: Callable | None = None
    for number in range(len(projects) - 1, -1, -1):
        features = {"number": number, "run": runs[number], "followed": sweep is not None}
        names = {"project": projects[number], "others": sweep}
        sweep = compiler.variant_of(np.float64, features)(filled(sweep_set, names))
    return sweep


@cache
def make_constraint_stage(real: Real, math: str, projection: Projection, in_planes: bool) -> Callable:
    """Compile stage(bands, colour, position, weights, before, constraints, fresh, parameters): a parallel loop over one
    colour."""
    compiler = Compiler(f"{projection.name}_{np.dtype(real).name}_{math}", math)
    run = make_projections(compiler, real, projection, in_planes)
    variant = compiler.variant_of(real, {"run": projection.run})
    return compiler.banded(variant.copied(filled(stage, {"project": run})))


@cache
def make_sweep_stage(real: Real, math: str, projections: tuple[Projection, ...]) -> Callable:
    """Compile stage(bands, position, weights, before, sets, fresh, parameters): all constraints once, in one call.

    Particles are rows; `sets`: those of the `projections`, at least one.
    """
    compiler = Compiler(f"sweep_{np.dtype(real).name}_{math}", math)
    projects = [make_projections(compiler, real, projection, False) for projection in projections]
    sweep = make_colours(compiler, projects, [projection.run for projection in projections])
    assert sweep is not None
    return compiler.team(sweep)
