"""The kernel `fused` in the Jacobi orderings: an iteration is one walk down a band of rows, from one buffer to another.

For each row the constraints that lead from it to the right and down are computed once, and their displacements stored
in rows of scratch (as in mass_spring/cloth/rows.py). A mass adds those of the constraints that it is the first end of,
with the opposite sign, and of those it is the second end of. At a band's first row the constraints that lead down to it
are computed once more.
"""

from __future__ import annotations

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import BLOCK, row_at
from softlab.cpu_backend.core.scratch import AXES, SPAN, clear_triple, row_edge
from softlab.cpu_backend.xpbd.layout import (
    P_BEFORE,
    P_BLOCKS,
    P_MULTIPLIERS,
    P_PLANE,
    P_ROWS,
    P_SCRATCH_WIDTH,
    P_STRIDE,
)
from softlab.cpu_backend.xpbd.rows import constants_of_even, constants_of_odd, family_features
from softlab.cpu_backend.xpbd.stage_projections import change as change_of
from softlab.cpu_backend.xpbd.walk import sheet_features
from softlab.model.base.types import Real
from softlab.model.base.variant import FEATURE, Open, open_constant, routine, row_routine
from softlab.model.formulas.distance import averaged, gathered, scaled
from softlab.model.position_based.plan import FAMILIES, families

PLANES = len(FAMILIES)  # of multipliers

first_triples = open_constant("first_triples: number of the first triple of scratch rows of each family")
gather_uneven = Open("gather_uneven(...): `gather_row` of masses with weights")
vertical = Open("vertical(i, stores, source, turn, later, scratch, sheet): `lead` of this family; so are the others")
falling, rising, horizontal = Open("falling(...)"), Open("rising(...)"), Open("horizontal(...)")
far_vertical, far_horizontal = Open("far_vertical(...)"), Open("far_horizontal(...)")
LEADS = ("vertical", "falling", "rising", "horizontal", "far_vertical", "far_horizontal")  # names of FAMILIES here


def displacement_triples(parts: frozenset[str]) -> dict[str, int]:
    """Return the rows of scratch of a band: a family's name -> number of its first triple (one row per axis), `idle`:
    one for multipliers that are not read, and `count`. Rows that a later one still reads are used in turn."""
    places, count = {}, 0
    for family in families(parts):
        places[family.name] = count
        count += family.rows + 1
    return places | {"idle": count, "count": count + 1}


def stencil_rows(parts: frozenset[str]) -> int:
    """Return the largest number of rows that a constraint leads down."""
    return max([family.rows for family in families(parts)], default=0)


@row_routine
def displace_row(
    blocks, x, y, z, far_x, far_y, far_z, old_x, old_y, old_z, old_far_x, old_far_y, old_far_z, multipliers, later,
    new_multipliers, reciprocals, rest, compliance, odd_compliance, damping, out_x, out_y, out_z,
):  # fmt: skip
    """Write displacements of the second ends."""
    for j in range(blocks * BLOCK):
        dx, dy = far_x[j] - x[j], far_y[j] - y[j]
        dz = far_z[j] - z[j] if FEATURE.axes == 3 else 0.0
        e, compliance_here = (dx, dy, dz), compliance
        if FEATURE.damped:
            ez = dz - (old_far_z[j] - old_z[j]) if FEATURE.axes == 3 else 0.0
            e = dx - (old_far_x[j] - old_x[j]), dy - (old_far_y[j] - old_y[j]), ez
        if FEATURE.alternating and FEATURE.soft and FEATURE.rows_down == 0:
            compliance_here = odd_compliance if j & 1 else compliance
        multiplier = 0.0
        if FEATURE.soft:
            multiplier = multipliers[j] if later else 0.0
        change, scale = change_of((dx, dy, dz), e, rest, compliance_here, damping, multiplier, reciprocals[j])
        if FEATURE.soft:
            new_multipliers[j] = multiplier + change
        out_x[j] = scaled(scale, dx)
        out_y[j] = scaled(scale, dy)
        if FEATURE.axes == 3:
            out_z[j] = scaled(scale, dz)


@routine
def lead(i, stores, source, turn, later, scratch, sheet):
    """Compute the displacements by the constraints of a family that lead from row `i`, at the positions from `source`
    on.

    `stores`: true if this walk writes their multipliers; `turn` 0 or 1: which of the two buffers has the current
    multipliers; `later`: true if there are any.
    """
    memory, places, parameters, row_places = sheet.memory, sheet.places, sheet.parameters, sheet.row_places
    stride, plane, width = places[P_STRIDE], places[P_PLANE], places[P_SCRATCH_WIDTH]
    row = min(i + FEATURE.rows_down, places[P_ROWS] - 1)  # below the last row there is none: reciprocals are 0
    first, second = source + i * stride, source + row * stride
    if FEATURE.rising:
        first = first + FEATURE.columns_along
    else:
        second = second + FEATURE.columns_along
    old = places[P_BEFORE] - source if FEATURE.damped else np.int64(0)
    triple, of_family = FEATURE.first_triple + i % (FEATURE.rows_down + 1), 2 + FEATURE.family
    here = row_at(memory, places[P_MULTIPLIERS] + (FEATURE.family + turn * PLANES) * plane + i * stride)
    there = row_at(memory, places[P_MULTIPLIERS] + (FEATURE.family + (1 - turn) * PLANES) * plane + i * stride)
    if not stores:
        there = row_at(scratch, row_edge(FEATURE.idle_triple, 0, width))
    even, odd = constants_of_even(parameters), constants_of_odd(parameters)
    constants = odd if FEATURE.rows_down > 0 and i & 1 else even
    displace_row(
        places[P_BLOCKS], row_at(memory, first), row_at(memory, first + plane), row_at(memory, first + 2 * plane),
        row_at(memory, second), row_at(memory, second + plane), row_at(memory, second + 2 * plane),
        row_at(memory, old + first), row_at(memory, old + first + plane), row_at(memory, old + first + 2 * plane),
        row_at(memory, old + second), row_at(memory, old + second + plane), row_at(memory, old + second + 2 * plane),
        here, later, there, row_at(memory, row_places[of_family, i]), constants.rest,
        constants.compliance, odd.compliance, constants.damping,
        row_at(scratch, row_edge(triple, 0, width) + SPAN), row_at(scratch, row_edge(triple, 1, width) + SPAN),
        row_at(scratch, row_edge(triple, 2, width) + SPAN),
    )  # fmt: skip


@row_routine
def gather_row(
    blocks, position, weights, valences, across, down, above, falling, falling_above, rising, rising_above, far_across,
    far_down, far_above, out,
):  # fmt: skip
    """Move one axis of a row by displacements, whose rows begin SPAN columns before the sheet's first one."""
    for k in range(SPAN, blocks * BLOCK + SPAN):
        total = 0.0
        if FEATURE.structural:
            total = (across[k - 1] - across[k]) + (above[k] - down[k])
        if FEATURE.shear:
            shear = (falling_above[k - 1] - falling[k]) + (rising_above[k] - rising[k - 1])
            total = total + shear if FEATURE.structural else shear
        if FEATURE.bending:
            bending = (far_across[k - 2] - far_across[k]) + (far_above[k] - far_down[k])
            total = total + bending if FEATURE.structural or FEATURE.shear else bending
        j = k - SPAN
        weight = weights[j] if FEATURE.uneven else 1.0
        if FEATURE.averaged_jacobi:
            out[j] = averaged(position[j], weight, total, valences[j])
        else:
            out[j] = gathered(position[j], weight, total)


@routine
def lead_down(i, stores, source, turn, later, scratch, sheet):
    if FEATURE.structural:
        vertical(i, stores, source, turn, later, scratch, sheet)
    if FEATURE.shear:
        falling(i, stores, source, turn, later, scratch, sheet)
        rising(i, stores, source, turn, later, scratch, sheet)
    if FEATURE.bending:
        far_vertical(i, stores, source, turn, later, scratch, sheet)


@routine
def open_walk(first, source, turn, later, scratch, sheet):
    """Prepare the scratch of a band that begins at row `first`."""
    if first < SPAN:
        for triple in range(FEATURE.triples):
            clear_triple(scratch, np.int64(triple), sheet.places[P_SCRATCH_WIDTH])
    for i in range(max(first - SPAN, 0), first):
        lead_down(i, False, source, turn, later, scratch, sheet)


@routine
def iterate_row(i, source, target, turn, later, scratch, sheet):
    """Move row `i` from the positions at `source` to those at `target`; see `lead`."""
    memory, places, row_places, row_uneven = sheet.memory, sheet.places, sheet.row_places, sheet.row_uneven
    plane, here, width = places[P_PLANE], i * places[P_STRIDE], places[P_SCRATCH_WIDTH]
    if FEATURE.structural:
        horizontal(i, True, source, turn, later, scratch, sheet)
    if FEATURE.bending:
        far_horizontal(i, True, source, turn, later, scratch, sheet)
    lead_down(i, True, source, turn, later, scratch, sheet)
    a_vertical, a_falling, a_rising, a_horizontal, a_far_vertical, a_far_horizontal = first_triples
    now, before, far_now, far_before = i % 2, (i + 1) % 2, i % 3, (i + 1) % 3
    for axis in range(FEATURE.axes):
        row = axis * plane + here
        arguments = (
            places[P_BLOCKS], row_at(memory, source + row), row_at(memory, row_places[0, i]),
            row_at(memory, row_places[1, i]), row_at(scratch, row_edge(a_horizontal, axis, width)),
            row_at(scratch, row_edge(a_vertical + now, axis, width)),
            row_at(scratch, row_edge(a_vertical + before, axis, width)),
            row_at(scratch, row_edge(a_falling + now, axis, width)),
            row_at(scratch, row_edge(a_falling + before, axis, width)),
            row_at(scratch, row_edge(a_rising + now, axis, width)),
            row_at(scratch, row_edge(a_rising + before, axis, width)),
            row_at(scratch, row_edge(a_far_horizontal, axis, width)),
            row_at(scratch, row_edge(a_far_vertical + far_now, axis, width)),
            row_at(scratch, row_edge(a_far_vertical + far_before, axis, width)), row_at(memory, target + row),
        )  # fmt: skip
        if row_uneven[i]:
            gather_uneven(*arguments)
        else:
            gather_row(*arguments)


def iteration_of(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], several: bool) -> dict[str, object]:
    """Return the constraints of a scene by their open names in `open_walk` and `iterate_row`."""
    assert axes <= AXES
    at = displacement_triples(parts)
    names: dict[str, object] = {}
    for name, family in zip(LEADS, FAMILIES, strict=True):
        if family.kind in parts:
            features = family_features(parts, axes, family, several)
            features |= {"first_triple": at[family.name], "idle_triple": at["idle"]}
            names[name] = compiler.variant_of(real, features)(lead)
    features = sheet_features(parts, axes, 1) | {"uneven": bool(parts & {"pins", "load"})}
    return names | {
        "gather_uneven": compiler.variant_of(real, features)(gather_row),
        "first_triples": tuple(at.get(family.name, at["idle"]) for family in FAMILIES),
    }
