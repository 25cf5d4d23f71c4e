"""Loops along a row of a combed sheet (xpbd/layout.py): prediction, projection, velocity. Each processes whole vectors.

A loop runs over a class of a row. Loops that use weights have a second version without, for rows whose masses are all
free and weigh as the sheet's: the same bits in less time.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.xpbd.layout import (
    P_BEFORE,
    P_BLOCKS,
    P_CLASS,
    P_MULTIPLIERS,
    P_PLANE,
    P_STRIDE,
)
from softlab.cpu_backend.xpbd.stage_projections import make_change
from softlab.model.base.tuples import reader
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import CONSTANTS
from softlab.model.formulas import distance
from softlab.model.position_based.plan import FAMILIES, Family


def make_motion_rows(
    compiler: Compiler, real: Real, parts: frozenset[str], apart: bool, has_forces: bool
) -> SimpleNamespace:
    """Make `predict` and `finish`, one axis of a row, `predict_uneven`, with weights, and `pin`, `factor_of` (see
    below).

    `predict` computes the predicted positions from those at the start of a substep, `finish` the velocity from the
    iterated positions. The position at the substep's start is stored in place of the velocity, which is not needed
    meanwhile; or `apart`.
    """
    formulas, block = compiler.formulas(distance, real), block_of(real)
    kicked, damping_factor, predicted, rate = (
        formulas.kicked,
        formulas.damping_factor,
        formulas.predicted,
        formulas.rate,
    )
    has_load, has_damping, has_gravity = "load" in parts, "damping" in parts, "gravity" in parts
    zero, one = real(0), real(1)
    moves = has_forces or has_gravity or has_damping

    def make_predict(uneven: bool) -> Callable:
        def predict(blocks, position, velocity, before, acceleration, gravity, weights, factor, drag, h):
            """Predict one axis; `acceleration`: of each mass, read if there are forces; else `gravity` is that of
            all."""
            for j in range(blocks * block):
                p, v, a = position[j], velocity[j], gravity
                if has_forces:
                    a = acceleration[j]
                if moves:
                    left = factor
                    if uneven and has_load and has_damping:
                        left = damping_factor(drag, weights[j])
                    v = kicked(v, left, h, a)
                new = predicted(p, h, v)
                if uneven:
                    new = new if weights[j] > zero else p
                position[j] = new
                if apart:
                    before[j] = p
                else:
                    velocity[j] = p

        predict.__name__ = "predict_uneven" if uneven else "predict"
        return compiler.row(predict)

    @compiler.row
    def finish(blocks, position, velocity, before, inverse_h):
        """Compute velocities. Pinned masses have not moved, so their velocity is 0."""
        for j in range(blocks * block):
            begin = before[j] if apart else velocity[j]
            velocity[j] = rate(position[j], begin, inverse_h)

    @compiler.row
    def pin(blocks, position, velocity, before, weights):
        """Reset pinned masses, whatever collided with them."""
        for j in range(blocks * block):
            free = weights[j] > zero
            position[j] = position[j] if free else before[j]
            velocity[j] = velocity[j] if free else zero

    @compiler.compiled
    def factor_of(factor, drag):
        """Return the damping factor of the velocity of a mass of weight 1."""
        if not has_damping:
            return one
        return damping_factor(drag, one) if has_load else factor

    return SimpleNamespace(
        predict=make_predict(False), predict_uneven=make_predict(True), finish=finish, pin=pin, factor_of=factor_of
    )


def make_project_row(compiler: Compiler, real: Real, axes: int, soft: bool, damped: bool, uneven: bool) -> Callable:
    """Make project(blocks, first, second, first_before, second_before, weights, weights, multipliers, later,
    reciprocals, rest, compliance, damping): constraints that lead from one run of numbers to another.

    `first` and so on: x, y, z rows; `later`: true if multipliers are known, else they are 0.
    """
    change_of = make_change(compiler, real, axes, soft, damped)
    moved, block, zero, one = compiler.formulas(distance, real).moved, block_of(real), real(0), real(1)

    def project(
        blocks, x, y, z, far_x, far_y, far_z, old_x, old_y, old_z, old_far_x, old_far_y, old_far_z,
        weights, far_weights, multipliers, later, reciprocals, rest, compliance, damping,
    ):  # fmt: skip
        for j in range(blocks * block):
            dx, dy = far_x[j] - x[j], far_y[j] - y[j]
            dz = far_z[j] - z[j] if axes == 3 else zero
            e = dx, dy, dz
            if damped:
                ez = dz - (old_far_z[j] - old_z[j]) if axes == 3 else zero
                e = dx - (old_far_x[j] - old_x[j]), dy - (old_far_y[j] - old_y[j]), ez
            multiplier = zero
            if soft:
                multiplier = multipliers[j] if later else zero
            change, scale = change_of((dx, dy, dz), e, rest, compliance, damping, multiplier, reciprocals[j])
            if soft:
                multipliers[j] = multiplier + change
            w, far_w = one, one
            if uneven:
                w, far_w = weights[j], far_weights[j]
            x[j] = moved(x[j], w, -scale, dx)
            y[j] = moved(y[j], w, -scale, dy)
            far_x[j] = moved(far_x[j], far_w, scale, dx)
            far_y[j] = moved(far_y[j], far_w, scale, dy)
            if axes == 3:
                z[j] = moved(z[j], w, -scale, dz)
                far_z[j] = moved(far_z[j], far_w, scale, dz)

    project.__name__ = "project" + "_soft" * soft + "_damped" * damped + "_uneven" * uneven
    return compiler.row(project)


def make_rows_of_kinds(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], several: bool
) -> dict[str, tuple[Callable, ...] | None]:
    """Make (even row, uneven row if any) by the kind of constraints. In a single iteration multipliers are 0 and not
    stored."""
    versions_of_kind: dict[tuple[bool, bool], tuple[Callable, ...]] = {}
    kinds = {}
    has_weights = bool(parts & {"pins", "load"})
    for kind in ("structural", "shear", "bending"):
        key = several and f"{kind}-compliance" in parts, f"{kind}-damping" in parts
        if kind in parts and key not in versions_of_kind:
            versions = (False, True) if has_weights else (False,)
            versions_of_kind[key] = tuple(make_project_row(compiler, real, axes, *key, uneven) for uneven in versions)
        kinds[kind] = versions_of_kind.get(key)
    return kinds


def make_link(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], family: Family, rows: Any, classes: int
) -> Callable:
    """Make link(i, later, sheet): the constraints of a family that lead down from row `i`, or both colours of those
    along it, one after the other. `sheet`: see xpbd/walk.py."""
    number, down = FAMILIES.index(family), family.rows
    right = family.columns if down else max(1, family.columns)
    stiff = family.kind == "structural" and "alternating" in parts
    constants_of_even = reader(CONSTANTS, compiler.compiled, f"constraint_{family.kind}_")
    constants_of_odd = reader(CONSTANTS, compiler.compiled, "constraint_stiff_") if stiff else constants_of_even
    has_weights, damped = bool(parts & {"pins", "load"}), f"{family.kind}-damping" in parts
    even_row, uneven_row = rows if has_weights else (rows[0], rows[0])
    # a class's constraints lead from its columns to those of the next class, or the reverse; behind the last class
    # comes the first one, shifted by one
    near_class, far_class = (0, right) if right >= 0 else (1, 0)
    of_a_colour = max(1, classes // 2)

    @compiler.compiled
    def run(i, c, odd, later, memory, places, parameters, row_places, row_uneven):
        stride, plane, spacing = places[P_STRIDE], places[P_PLANE], places[P_CLASS]
        near, far = c + near_class, c + far_class
        near_lane, far_lane = near % classes * spacing + near // classes, far % classes * spacing + far // classes
        here, lane = i * stride, c * spacing
        first, second = here + near_lane, here + down * stride + far_lane
        old = places[P_BEFORE] if damped else np.int64(0)
        constants = constants_of_odd(parameters) if odd else constants_of_even(parameters)
        arguments = (
            places[P_BLOCKS], row_at(memory, first), row_at(memory, first + plane), row_at(memory, first + 2 * plane),
            row_at(memory, second), row_at(memory, second + plane), row_at(memory, second + 2 * plane),
            row_at(memory, old + first), row_at(memory, old + first + plane), row_at(memory, old + first + 2 * plane),
            row_at(memory, old + second), row_at(memory, old + second + plane), row_at(memory, old + second + 2 * plane),
            row_at(memory, row_places[0, i] + near_lane), row_at(memory, row_places[0, i + down] + far_lane),
            row_at(memory, places[P_MULTIPLIERS] + number * plane + here + lane), later,
            row_at(memory, row_places[2 + number, i] + lane), constants.rest, constants.compliance, constants.damping,
        )  # fmt: skip
        if row_uneven[i] or row_uneven[i + down]:
            uneven_row(*arguments)
        else:
            even_row(*arguments)

    @compiler.compiled
    def link(i, later, sheet):
        memory, places, parameters, row_places = sheet.memory, sheet.places, sheet.parameters, sheet.row_places
        row_uneven = sheet.row_uneven
        if down > 0:
            for c in range(classes):
                run(i, np.int64(c), i & 1, later, memory, places, parameters, row_places, row_uneven)
        else:
            for k in range(classes):  # first those of colour 0
                colour, turn = k // of_a_colour, k % of_a_colour
                column = (turn // right * 2 + colour) * right + turn % right
                run(i, np.int64(column), colour, later, memory, places, parameters, row_places, row_uneven)

    return link
