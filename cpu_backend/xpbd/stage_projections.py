"""Projections of the teaching version: a colour of a family of constraints at a time, or all of them at once (Jacobi).

Constraints are numbered as in model/position_based/plan.py: the one with the index (i, j) of a family leads `down` rows down
and `right` columns to the right; for right = -1 from column j + 1 to column j.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import prange

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.scratch import cloth_variant
from softlab.cpu_backend.xpbd.tables import kind_of
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import (
    constants_of,
)
from softlab.model.core.plan import Moment, StageRun
from softlab.model.formulas import distance, lengths
from softlab.model.position_based.plan import FAMILIES, colour_order, families

MARGIN = 2  # rows and columns of displacements around the sheet, without constraints


def make_change(compiler: Compiler, real: Real, axes: int, soft: bool, damped: bool) -> Callable:
    """Make change(d, e, rest, compliance, damping, multiplier, reciprocal) -> (change, scale) of one constraint.

    `d`, `e`: the vector between its ends, and its change in the substep, three numbers each.
    """
    formulas = compiler.formulas(distance, real)
    rigid_change, soft_change, damped_change = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    squares = compiler.formulas(lengths, real)
    squared_length_2d, squared_length_3d = squares.squared_length, squares.squared_length_3d
    along_2d, along_3d = formulas.along_2d, squares.dot

    @compiler.compiled
    def change(d, e, rest, compliance, damping, multiplier, reciprocal):
        squared = squared_length_2d(d[0], d[1]) if axes == 2 else squared_length_3d(d[0], d[1], d[2])
        if damped:
            if axes == 2:
                along, passed = along_2d(d[0], d[1], e[0], e[1]), along_2d(e[0], e[1], e[0], e[1])
            else:
                along = along_3d(d[0], d[1], d[2], e[0], e[1], e[2])
                passed = along_3d(e[0], e[1], e[2], e[0], e[1], e[2])
            return damped_change(squared, rest, reciprocal, compliance, multiplier, damping, along, passed)
        if soft:
            return soft_change(squared, rest, reciprocal, compliance, multiplier)
        return rigid_change(squared, rest, reciprocal)

    return change


def make_kind(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], soft: bool, damped: bool
) -> SimpleNamespace:
    """Make `project` (in place, a colour) and `displace` (the terms of a Jacobi sum) of a kind of constraints."""
    compiled, kernel = compiler.compiled, compiler.kernel
    formulas = compiler.formulas(distance, real)
    moved, reciprocal_of, scaled, weighted_valence = (
        formulas.moved,
        formulas.reciprocal,
        formulas.scaled,
        formulas.weighted_valence,
    )
    change_of = make_change(compiler, real, axes, soft, damped)
    by_formula, weighted = "load" in parts or "averaged-jacobi" in parts or "jacobi" in parts, "jacobi" in parts
    zero, one = real(0), real(1)

    @compiled
    def reciprocal(total, constants):
        if by_formula:
            return reciprocal_of(total, constants.stiffening, constants.compliance)
        if total > one:
            return constants.both
        return constants.one if total > zero else zero

    @compiled
    def difference(sheet, i, j, row, column):
        z = sheet[2, row, column] - sheet[2, i, j] if axes == 3 else zero
        return sheet[0, row, column] - sheet[0, i, j], sheet[1, row, column] - sheet[1, i, j], z

    @compiled
    def solve(position, before, multiplier, total, constants, i, j, row, column):
        d = difference(position, i, j, row, column)
        e = d
        if damped:
            old = difference(before, i, j, row, column)
            e = d[0] - old[0], d[1] - old[1], d[2] - old[2]
        change, scale = change_of(
            d, e, constants.rest, constants.compliance, constants.damping, multiplier, reciprocal(total, constants),
        )  # fmt: skip
        return change, scale, d

    @kernel
    def project(position, before, multipliers, weights, constants, down, right, colour):
        rows, columns = weights.shape
        for k in prange(rows - down):
            i = np.int64(k)
            if down == 0 or i // down % 2 == colour:
                for j in range(columns - abs(right)):
                    if down > 0 or j // right % 2 == colour:
                        first, row, second = j + max(0, -right), i + down, j + max(0, right)
                        w_first, w_second = weights[i, first], weights[row, second]
                        change, scale, d = solve(
                            position, before, multipliers[i, j], w_first + w_second, constants, i, first, row, second
                        )
                        multipliers[i, j] += change
                        for axis in range(axes):
                            position[axis, i, first] = moved(position[axis, i, first], w_first, -scale, d[axis])
                            position[axis, row, second] = moved(position[axis, row, second], w_second, scale, d[axis])

    @kernel
    def displace(position, before, multipliers, weights, valences, even, odd, down, right, out):
        """Write displacements of the second ends, the opposite of the first ones', to `out` (axes, rows + 2 ROOM,
        columns + 2 ROOM). `odd`: the constants of constraints between odd columns and the next, or odd rows."""
        rows, columns = weights.shape
        for k in prange(rows - down):
            i = np.int64(k)
            for j in range(columns - abs(right)):
                first, row, second = j + max(0, -right), i + down, j + max(0, right)
                constants = odd if (i if down > 0 else j) % 2 else even
                w_first, w_second = weights[i, first], weights[row, second]
                if weighted:
                    w_first, w_second = (
                        weighted_valence(valences[i, first], w_first),
                        weighted_valence(valences[row, second], w_second),
                    )
                change, scale, d = solve(
                    position, before, multipliers[i, j], w_first + w_second, constants, i, first, row, second,
                )  # fmt: skip
                multipliers[i, j] += change
                for axis in range(axes):
                    out[axis, i + MARGIN, j + MARGIN] = scaled(scale, d[axis])

    return SimpleNamespace(project=project, displace=displace)


def make_gather(compiler: Compiler, real: Real, axes: int, parts: frozenset[str]) -> Callable:
    """Make gather(position, displacements, weights, valences): it moves every mass by the sum of its displacements."""
    formulas = compiler.formulas(distance, real)
    gathered, averaged = formulas.gathered, formulas.averaged
    has_structural, has_shear, has_bending = (kind in parts for kind in ("structural", "shear", "bending"))
    in_the_mean = "averaged-jacobi" in parts
    zero = real(0)

    def gather(position, displacements, weights, valences):
        vertical, falling, rising, horizontal, vertical_bending, horizontal_bending = displacements
        rows, columns = weights.shape
        for row in prange(rows):
            for column in range(columns):
                i, j = np.int64(row) + MARGIN, column + MARGIN
                for axis in range(axes):
                    total = zero
                    if has_structural:
                        right, left = -horizontal[axis, i, j], horizontal[axis, i, j - 1]
                        below, above = -vertical[axis, i, j], vertical[axis, i - 1, j]
                        total = (right + left) + (below + above)
                    if has_shear:
                        below_right, above_left = -falling[axis, i, j], falling[axis, i - 1, j - 1]
                        below_left, above_right = -rising[axis, i, j - 1], rising[axis, i - 1, j]
                        shear = (below_right + above_left) + (below_left + above_right)
                        total = total + shear if has_structural else shear
                    if has_bending:
                        right, left = -horizontal_bending[axis, i, j], horizontal_bending[axis, i, j - 2]
                        below, above = -vertical_bending[axis, i, j], vertical_bending[axis, i - 2, j]
                        bending = (right + left) + (below + above)
                        total = total + bending if has_structural or has_shear else bending
                    p, w = position[axis, row, column], weights[row, column]
                    if in_the_mean:
                        position[axis, row, column] = averaged(p, w, total, valences[row, column])
                    else:
                        position[axis, row, column] = gathered(p, w, total)

    return compiler.kernel(gather)


def make_attach(compiler: Compiler, real: Real, axes: int) -> Callable:
    """Make attach(position, weights, anchor, max_distance): it pulls masses back to the maximum distance of their anchors.
    `anchor` (count, rows, columns): the particle; `max_distance` [m], the same shape."""
    formulas = compiler.formulas(distance, real)
    tether, tethered = formulas.tether, formulas.tethered
    squares = compiler.formulas(lengths, real)
    squared_length_2d, squared_length_3d = squares.squared_length, squares.squared_length_3d
    zero = real(0)

    def attach(position, weights, anchor, max_distance):
        count, rows, columns = anchor.shape
        for i in prange(rows):
            for j in range(columns):
                for k in range(count):
                    if weights[i, j] > zero:
                        row, column = anchor[k, i, j] // columns, anchor[k, i, j] % columns
                        dx = position[0, i, j] - position[0, row, column]
                        dy = position[1, i, j] - position[1, row, column]
                        dz = position[2, i, j] - position[2, row, column] if axes == 3 else zero
                        squared = squared_length_2d(dx, dy) if axes == 2 else squared_length_3d(dx, dy, dz)
                        factor, d = tether(squared, max_distance[k, i, j]), (dx, dy, dz)
                        for axis in range(axes):
                            p = position[axis, i, j]
                            position[axis, i, j] = tethered(p, position[axis, row, column], d[axis], factor)

    return compiler.kernel(attach)


def make_projections(real: Real, math: str, axes: int, parts: frozenset[str]) -> SimpleNamespace:
    """Compile `kinds`, `project` and `displace` of each kind of constraints; `gather`, `attach`."""
    matter = parts & {"load", "jacobi", "averaged-jacobi"}
    kinds = {}
    for kind in {family.kind for family in families(parts)}:
        soft, damped = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
        words = matter | {word for word, there in (("compliance", soft), ("spring-damping", damped)) if there}
        compiler = Compiler(cloth_variant(f"project_{axes}d", real, math, words), math)
        kinds[kind] = make_kind(compiler, real, axes, parts, soft, damped)
    sums = parts & {"structural", "shear", "bending", "averaged-jacobi"}
    gather = make_gather(Compiler(cloth_variant(f"gather_{axes}d", real, math, sums), math), real, axes, parts)
    attach = make_attach(Compiler(cloth_variant(f"attach_{axes}d", real, math, frozenset()), math), real, axes)
    return SimpleNamespace(kinds=kinds, gather=gather, attach=attach)


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

    def project(family: Any, colour: int) -> StageRun:
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
