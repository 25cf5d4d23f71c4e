"""Projections of the teaching version: a colour of a family of constraints at a time, or all of them at once (Jacobi).

Constraints are numbered as in model/position_based/plan.py: the one with the index (i, j) of a family leads `down` rows down
and `right` columns to the right; for right = -1 from column j + 1 to column j.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.tables import kind_of
from softlab.model.base.types import Features, Real
from softlab.model.base.variant import FEATURE, features_of, routine
from softlab.model.contact.substep_parameters import (
    constants_of,
)
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas.distance import (
    along_2d,
    averaged,
    damped_change,
    gathered,
    moved,
    rigid_change,
    scaled,
    soft_change,
    tether,
    tethered,
    weighted_valence,
)
from softlab.model.formulas.distance import reciprocal as reciprocal_of
from softlab.model.formulas.lengths import dot, squared_length, squared_length_3d
from softlab.model.position_based.plan import FAMILIES, Family, colour_order, families

MARGIN = 2  # rows and columns of displacements around the sheet, without constraints


@routine
def change(d, e, rest, compliance, damping, multiplier, reciprocal):
    """Return (change, its scale) of a constraint.

    `d`, `e`: the vector between its ends, and its change in the substep, three numbers each.
    """
    squared = squared_length(d[0], d[1]) if FEATURE.axes == 2 else squared_length_3d(d[0], d[1], d[2])
    if FEATURE.damped:
        if FEATURE.axes == 2:
            along, passed = along_2d(d[0], d[1], e[0], e[1]), along_2d(e[0], e[1], e[0], e[1])
        else:
            along = dot(d[0], d[1], d[2], e[0], e[1], e[2])
            passed = dot(e[0], e[1], e[2], e[0], e[1], e[2])
        return damped_change(squared, rest, reciprocal, compliance, multiplier, damping, along, passed)
    if FEATURE.soft:
        return soft_change(squared, rest, reciprocal, compliance, multiplier)
    return rigid_change(squared, rest, reciprocal)


@routine
def reciprocal(total, constants):
    if FEATURE.load or FEATURE.averaged_jacobi or FEATURE.jacobi:
        return reciprocal_of(total, constants.stiffening, constants.compliance)
    if total > 1.0:
        return constants.both
    return constants.one if total > 0.0 else 0.0


@routine
def difference(sheet, i, j, row, column):
    z = sheet[2, row, column] - sheet[2, i, j] if FEATURE.axes == 3 else 0.0
    return sheet[0, row, column] - sheet[0, i, j], sheet[1, row, column] - sheet[1, i, j], z


@routine
def solve(position, before, multiplier, total, constants, i, j, row, column):
    d = difference(position, i, j, row, column)
    e = d
    if FEATURE.damped:
        old = difference(before, i, j, row, column)
        e = d[0] - old[0], d[1] - old[1], d[2] - old[2]
    added, scale = change(
        d, e, constants.rest, constants.compliance, constants.damping, multiplier, reciprocal(total, constants),
    )  # fmt: skip
    return added, scale, d


@routine
def project(position, before, multipliers, weights, constants, down, right, colour):
    """Project a colour of a kind of constraints in place."""
    rows, columns = weights.shape
    for k in prange(rows - down):
        i = np.int64(k)
        if down == 0 or i // down % 2 == colour:
            for j in range(columns - abs(right)):
                if down > 0 or j // right % 2 == colour:
                    first, row, second = j + max(0, -right), i + down, j + max(0, right)
                    w_first, w_second = weights[i, first], weights[row, second]
                    added, scale, d = solve(
                        position, before, multipliers[i, j], w_first + w_second, constants, i, first, row, second
                    )
                    multipliers[i, j] += added
                    for axis in range(FEATURE.axes):
                        position[axis, i, first] = moved(position[axis, i, first], w_first, -scale, d[axis])
                        position[axis, row, second] = moved(position[axis, row, second], w_second, scale, d[axis])


@routine
def displace(position, before, multipliers, weights, valences, even, odd, down, right, out):
    """Write displacements of the second ends, the opposite of the first ones', to `out` (axes, rows + 2 MARGIN,
    columns + 2 MARGIN). `odd`: the constants of constraints between odd columns and the next, or odd rows."""
    rows, columns = weights.shape
    for k in prange(rows - down):
        i = np.int64(k)
        for j in range(columns - abs(right)):
            first, row, second = j + max(0, -right), i + down, j + max(0, right)
            constants = odd if (i if down > 0 else j) % 2 else even
            w_first, w_second = weights[i, first], weights[row, second]
            if FEATURE.jacobi:
                w_first, w_second = (
                    weighted_valence(valences[i, first], w_first),
                    weighted_valence(valences[row, second], w_second),
                )
            added, scale, d = solve(
                position, before, multipliers[i, j], w_first + w_second, constants, i, first, row, second,
            )  # fmt: skip
            multipliers[i, j] += added
            for axis in range(FEATURE.axes):
                out[axis, i + MARGIN, j + MARGIN] = scaled(scale, d[axis])


@routine
def gather(position, displacements, weights, valences):
    """Move every mass by the sum of its displacements."""
    vertical, falling, rising, horizontal, vertical_bending, horizontal_bending = displacements
    rows, columns = weights.shape
    for row in prange(rows):
        for column in range(columns):
            i, j = np.int64(row) + MARGIN, column + MARGIN
            for axis in range(FEATURE.axes):
                total = 0.0
                if FEATURE.structural:
                    right, left = -horizontal[axis, i, j], horizontal[axis, i, j - 1]
                    below, above = -vertical[axis, i, j], vertical[axis, i - 1, j]
                    total = (right + left) + (below + above)
                if FEATURE.shear:
                    below_right, above_left = -falling[axis, i, j], falling[axis, i - 1, j - 1]
                    below_left, above_right = -rising[axis, i, j - 1], rising[axis, i - 1, j]
                    shear = (below_right + above_left) + (below_left + above_right)
                    total = total + shear if FEATURE.structural else shear
                if FEATURE.bending:
                    right, left = -horizontal_bending[axis, i, j], horizontal_bending[axis, i, j - 2]
                    below, above = -vertical_bending[axis, i, j], vertical_bending[axis, i - 2, j]
                    bending = (right + left) + (below + above)
                    total = total + bending if FEATURE.structural or FEATURE.shear else bending
                p, w = position[axis, row, column], weights[row, column]
                if FEATURE.averaged_jacobi:
                    position[axis, row, column] = averaged(p, w, total, valences[row, column])
                else:
                    position[axis, row, column] = gathered(p, w, total)


@routine
def attach(position, weights, anchor, max_distance):
    """Pull masses back to the maximum distance of their anchors; `anchor` (count, rows, columns): the particle;
    `max_distance` [m], the same shape."""
    count, rows, columns = anchor.shape
    for i in prange(rows):
        for j in range(columns):
            for k in range(count):
                if weights[i, j] > 0.0:
                    row, column = anchor[k, i, j] // columns, anchor[k, i, j] % columns
                    dx = position[0, i, j] - position[0, row, column]
                    dy = position[1, i, j] - position[1, row, column]
                    dz = position[2, i, j] - position[2, row, column] if FEATURE.axes == 3 else 0.0
                    squared = squared_length(dx, dy) if FEATURE.axes == 2 else squared_length_3d(dx, dy, dz)
                    factor, d = tether(squared, max_distance[k, i, j]), (dx, dy, dz)
                    for axis in range(FEATURE.axes):
                        p = position[axis, i, j]
                        position[axis, i, j] = tethered(p, position[axis, row, column], d[axis], factor)


def _compiled(
    routines: Sequence[Callable], name: str, real: Real, math: str, words: frozenset[str], features: Features
) -> SimpleNamespace:
    """Compile kernels by their names; `words`: the parts that affect them."""
    compiler = Compiler(cloth_variant(f"{name}_{features['axes']}d", real, math, words), math)
    variant = compiler.variant_of(real, {**features_of(words), **features})
    return SimpleNamespace(**{one.__name__: compiler.kernel(variant.copied(one)) for one in routines})


def make_projections(real: Real, math: str, axes: int, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `kinds`, `project` and `displace` of each kind of constraints; `gather`, `attach`."""
    matter, features, kinds = parts & {"load", "jacobi", "averaged-jacobi"}, {"axes": axes}, {}
    for kind in {family.kind for family in families(parts)}:
        soft, damped = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
        words = matter | {word for word, there in (("compliance", soft), ("spring-damping", damped)) if there}
        of_kind = features | {"soft": soft, "damped": damped}
        kinds[kind] = _compiled((project, displace), "project", real, math, words, of_kind)
    sums = parts & {"structural", "shear", "bending", "averaged-jacobi"}
    return SimpleNamespace(
        kinds=kinds,
        **vars(_compiled([gather], "gather", real, math, sums, features)),
        **vars(_compiled([attach], "attach", real, math, frozenset(), features)),
    )


def bind_projections(
    sim: Any,
    make: SimpleNamespace,
    position: np.ndarray,
    before: np.ndarray,
    multipliers: np.ndarray,
    weights: np.ndarray,
) -> dict[str, StageRun]:
    """Return the functions of the stages of an iteration of `sim`, a cpu_backend.xpbd.solver.PositionBased."""
    parts = sim.plan.parts

    def project(family: Family, colour: int) -> StageRun:
        run, kind = make.kinds[family.kind].project, kind_of(family, colour, parts)
        multiplier = multipliers[FAMILIES.index(family)]

        def stage(moment: Moment) -> None:
            run(
                position,
                before,
                multiplier,
                weights,
                constants_of(sim.record, kind),
                family.rows,
                family.columns,
                colour,
            )

        return stage

    stages = {f"project {family.name} {colour}": project(family, colour) for family, colour in colour_order(parts)}
    if "gauss-seidel" not in parts:
        rows, number = sim.tables.valences()
        valences = rows[number]
        axes, height, width = position.shape
        planes = np.zeros((len(FAMILIES), axes, height + 2 * MARGIN, width + 2 * MARGIN), sim.real)
        displacements = tuple(planes)

        def project_all(moment: Moment) -> None:
            for family in families(parts):
                k, kinds = FAMILIES.index(family), [kind_of(family, colour, parts) for colour in (0, 1)]
                make.kinds[family.kind].displace(
                    position, before, multipliers[k], weights, valences,
                    *(constants_of(sim.record, kind) for kind in kinds), family.rows, family.columns,
                    displacements[k],
                )  # fmt: skip
            make.gather(position, displacements, weights, valences)

        stages = {"project all": project_all}
    if "attachments" in parts:
        anchor, max_distance = sim.attachments
        stages["attachments"] = lambda moment: make.attach(position, weights, anchor, max_distance)
    return stages
