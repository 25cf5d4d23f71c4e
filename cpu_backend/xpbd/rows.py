"""Loops along a row of a combed sheet (xpbd/layout.py): prediction, projection, velocity. Each processes whole vectors.

A loop runs over a class of a row. Loops that use weights have a second version without, for rows whose masses are all
free and weigh as the sheet's: the same bits in less time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, row_at
from softlab.cpu_backend.xpbd.layout import (
    P_BEFORE,
    P_BLOCKS,
    P_CLASS,
    P_MULTIPLIERS,
    P_PLANE,
    P_STRIDE,
)
from softlab.cpu_backend.xpbd.stage_projections import change as change_of
from softlab.model.base.types import Feature, Real
from softlab.model.base.variant import FEATURE, Open, features_of, filled, routine, row_routine, unrolled
from softlab.model.contact.substep_parameters import CONSTANTS, NAMES, Constants
from softlab.model.formulas.distance import damping_factor, kicked, moved, predicted, rate
from softlab.model.position_based.plan import FAMILIES, Family

NAMES_OF_FAMILIES, STIFF_NAMES, NUMBERS = (
    tuple(NAMES[family.kind] for family in FAMILIES),
    NAMES["stiff"],
    len(CONSTANTS),
)
project_even = Open("project_even(...): `project_row` of masses of weight 1")
project_uneven = Open("project_uneven(...): `project_row` of masses with weights")


@routine
def constants_of_even(parameters):
    """Return the constants of a family."""
    return Constants(*tuple(parameters[NAMES_OF_FAMILIES[FEATURE.family][n]] for n in unrolled(NUMBERS)))


@routine
def constants_of_odd(parameters):
    """Return the constants of a family's constraints of the odd colour."""
    if FEATURE.alternating:
        return Constants(*tuple(parameters[STIFF_NAMES[n]] for n in unrolled(NUMBERS)))
    return constants_of_even(parameters)


@row_routine
def predict(blocks, position, velocity, before, acceleration, gravity, weights, factor, drag, h):
    """Predict one axis; `acceleration`: of each mass, read if there are forces; else `gravity` is that of all.

    The position at the substep's start is stored in place of the velocity, which is not needed meanwhile, or separately.
    """
    for j in range(blocks * BLOCK):
        p, v, a = position[j], velocity[j], gravity
        if FEATURE.mass_forces:
            a = acceleration[j]
        if FEATURE.mass_forces or FEATURE.gravity or FEATURE.damping:
            left = factor
            if FEATURE.uneven and FEATURE.load and FEATURE.damping:
                left = damping_factor(drag, weights[j])
            v = kicked(v, left, h, a)
        new = predicted(p, h, v)
        if FEATURE.uneven:
            new = new if weights[j] > 0.0 else p
        position[j] = new
        if FEATURE.separate_before:
            before[j] = p
        else:
            velocity[j] = p


@row_routine
def finish(blocks, position, velocity, before, inverse_h):
    """Compute velocities. Pinned masses have not moved, so their velocity is 0."""
    for j in range(blocks * BLOCK):
        begin = before[j] if FEATURE.separate_before else velocity[j]
        velocity[j] = rate(position[j], begin, inverse_h)


@row_routine
def pin(blocks, position, velocity, before, weights):
    """Reset pinned masses, after collisions."""
    for j in range(blocks * BLOCK):
        free = weights[j] > 0.0
        position[j] = position[j] if free else before[j]
        velocity[j] = velocity[j] if free else 0.0


@routine
def factor_of(factor, drag):
    """Return the damping factor of the velocity of a mass of weight 1."""
    if not FEATURE.damping:
        return 1.0
    return damping_factor(drag, 1.0) if FEATURE.load else factor


@row_routine
def project_row(
    blocks, x, y, z, far_x, far_y, far_z, old_x, old_y, old_z, old_far_x, old_far_y, old_far_z,
    weights, far_weights, multipliers, later, reciprocals, rest, compliance, damping,
):  # fmt: skip
    """Project constraints that lead from one run of numbers to another; `later`: true if multipliers are known, else
    they are 0."""
    for j in range(blocks * BLOCK):
        dx, dy = far_x[j] - x[j], far_y[j] - y[j]
        dz = far_z[j] - z[j] if FEATURE.axes == 3 else 0.0
        e = dx, dy, dz
        if FEATURE.damped:
            ez = dz - (old_far_z[j] - old_z[j]) if FEATURE.axes == 3 else 0.0
            e = dx - (old_far_x[j] - old_x[j]), dy - (old_far_y[j] - old_y[j]), ez
        multiplier = 0.0
        if FEATURE.soft:
            multiplier = multipliers[j] if later else 0.0
        change, scale = change_of((dx, dy, dz), e, rest, compliance, damping, multiplier, reciprocals[j])
        if FEATURE.soft:
            multipliers[j] = multiplier + change
        w, far_w = 1.0, 1.0
        if FEATURE.uneven:
            w, far_w = weights[j], far_weights[j]
        x[j] = moved(x[j], w, -scale, dx)
        y[j] = moved(y[j], w, -scale, dy)
        far_x[j] = moved(far_x[j], far_w, scale, dx)
        far_y[j] = moved(far_y[j], far_w, scale, dy)
        if FEATURE.axes == 3:
            z[j] = moved(z[j], w, -scale, dz)
            far_z[j] = moved(far_z[j], far_w, scale, dz)


@routine
def project_class(i, c, odd, later, memory, places, parameters, row_places, row_uneven):
    """Project the constraints of a family that lead down from class `c` of row `i`, or from there along it.

    They lead from its columns to those of the next class, or the reverse; behind the last class comes the first one,
    shifted by one.
    """
    stride, plane, spacing, classes = places[P_STRIDE], places[P_PLANE], places[P_CLASS], FEATURE.classes
    near = c + 1 if FEATURE.rising else c
    far = c if FEATURE.rising else c + FEATURE.columns_along
    near_lane, far_lane = near % classes * spacing + near // classes, far % classes * spacing + far // classes
    here, lane, below = i * stride, c * spacing, i + FEATURE.rows_down
    first, second = here + near_lane, here + FEATURE.rows_down * stride + far_lane
    old = places[P_BEFORE] if FEATURE.damped else np.int64(0)
    constants = constants_of_odd(parameters) if odd else constants_of_even(parameters)
    of_family = 2 + FEATURE.family
    arguments = (
        places[P_BLOCKS], row_at(memory, first), row_at(memory, first + plane), row_at(memory, first + 2 * plane),
        row_at(memory, second), row_at(memory, second + plane), row_at(memory, second + 2 * plane),
        row_at(memory, old + first), row_at(memory, old + first + plane), row_at(memory, old + first + 2 * plane),
        row_at(memory, old + second), row_at(memory, old + second + plane), row_at(memory, old + second + 2 * plane),
        row_at(memory, row_places[0, i] + near_lane), row_at(memory, row_places[0, below] + far_lane),
        row_at(memory, places[P_MULTIPLIERS] + FEATURE.family * plane + here + lane), later,
        row_at(memory, row_places[of_family, i] + lane), constants.rest, constants.compliance, constants.damping,
    )  # fmt: skip
    if row_uneven[i] or row_uneven[below]:
        project_uneven(*arguments)
    else:
        project_even(*arguments)


@routine
def link(i, later, sheet):
    """Project the constraints of a family that lead down from row `i`, or both colours of those along it, one after the
    other; `sheet`: see xpbd/walk.py."""
    memory, places, parameters, row_places = sheet.memory, sheet.places, sheet.parameters, sheet.row_places
    if FEATURE.rows_down > 0:
        for c in range(FEATURE.classes):
            project_class(i, np.int64(c), i & 1, later, memory, places, parameters, row_places, sheet.row_uneven)
    else:
        along, of_a_colour = FEATURE.columns_along, max(1, FEATURE.classes // 2)
        for k in range(FEATURE.classes):  # first those of colour 0
            colour, turn = k // of_a_colour, k % of_a_colour
            c = (turn // along * 2 + colour) * along + turn % along
            project_class(i, np.int64(c), colour, later, memory, places, parameters, row_places, sheet.row_uneven)


def family_features(parts: frozenset[str], axes: int, family: Family, several: bool) -> dict[str, Feature]:
    """Return the features of the routines of a family. In a single iteration multipliers are 0 and not stored."""
    return {
        **features_of(parts),
        "axes": axes, "family": FAMILIES.index(family), "rows_down": family.rows, "columns_along": abs(family.columns),
        "rising": family.columns < 0, "soft": several and f"{family.kind}-compliance" in parts,
        "damped": f"{family.kind}-damping" in parts,
        "alternating": family.kind == "structural" and "alternating" in parts,
    }  # fmt: skip


def make_link(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], family: Family, classes: int, several: bool
) -> Callable:
    """Compile `link` for a family."""
    features = family_features(parts, axes, family, several) | {"classes": classes}
    names = {}
    for version in ("even", "uneven"):
        uneven = version == "uneven" and bool(parts & {"pins", "load"})
        names[f"project_{version}"] = compiler.variant_of(real, features | {"uneven": uneven})(project_row)
    return compiler.variant_of(real, features)(filled(link, names))
