"""The kernel `fused` in the Jacobi orderings: an iteration is one walk down a band of rows, from one buffer to another.

For each row the constraints that lead from it to the right and down are computed once, and their displacements stored
in rows of scratch (as in mass_spring/cloth/rows.py). A mass adds those of the constraints that it is the first end of,
with the opposite sign, and of those it is the second end of. At a band's first row the constraints that lead down to it
are computed once more.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from softlab.cpu_backend.core.compile import Compiler
from softlab.cpu_backend.core.layout import block_of, row_at
from softlab.cpu_backend.core.scratch import AXES, SPAN, make_scratch
from softlab.cpu_backend.xpbd.layout import (
    P_BEFORE,
    P_BLOCKS,
    P_MULTIPLIERS,
    P_PLANE,
    P_ROWS,
    P_SCRATCH_WIDTH,
    P_STRIDE,
)
from softlab.cpu_backend.xpbd.stage_projections import make_change
from softlab.model.base.tuples import reader
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import CONSTANTS
from softlab.model.formulas import distance
from softlab.model.position_based.plan import FAMILIES, Family, families


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


def make_displace_row(
    compiler: Compiler, real: Real, axes: int, soft: bool, damped: bool, alternates: bool
) -> Callable:
    """Make displace(blocks, first, second, first_before, second_before, multipliers, later, new_multipliers,
    reciprocals, rest, compliance, odd_compliance, damping, out): displacements of the second ends. `first` and so on:
    x, y, z rows."""
    change_of = make_change(compiler, real, axes, soft, damped)
    scaled, block, zero = compiler.formulas(distance, real).scaled, block_of(real), real(0)

    def displace(
        blocks, x, y, z, far_x, far_y, far_z, old_x, old_y, old_z, old_far_x, old_far_y, old_far_z, multipliers, later,
        new_multipliers, reciprocals, rest, compliance, odd_compliance, damping, out_x, out_y, out_z,
    ):  # fmt: skip
        for j in range(blocks * block):
            dx, dy = far_x[j] - x[j], far_y[j] - y[j]
            dz = far_z[j] - z[j] if axes == 3 else zero
            e, compliance_here = (dx, dy, dz), compliance
            if damped:
                ez = dz - (old_far_z[j] - old_z[j]) if axes == 3 else zero
                e = dx - (old_far_x[j] - old_x[j]), dy - (old_far_y[j] - old_y[j]), ez
            if alternates:
                compliance_here = odd_compliance if j & 1 else compliance
            multiplier = zero
            if soft:
                multiplier = multipliers[j] if later else zero
            change, scale = change_of((dx, dy, dz), e, rest, compliance_here, damping, multiplier, reciprocals[j])
            if soft:
                new_multipliers[j] = multiplier + change
            out_x[j] = scaled(scale, dx)
            out_y[j] = scaled(scale, dy)
            if axes == 3:
                out_z[j] = scaled(scale, dz)

    displace.__name__ = "displace" + "_soft" * soft + "_damped" * damped + "_alternating" * alternates
    return compiler.row(displace)


def make_lead(
    compiler: Compiler, real: Real, axes: int, parts: frozenset[str], family: Family, several: bool, edge: Callable
) -> Callable:
    """Make lead(i, stores, source, turn, later, scratch, sheet): the constraints of a family that lead from row `i`, at
    the positions from `source` on.

    `stores`: true if this walk writes their multipliers; `turn` 0 or 1: which of the two buffers has the current
    multipliers; `later`: true if there are any.
    """
    number, down, right = FAMILIES.index(family), family.rows, family.columns
    soft, damped = several and f"{family.kind}-compliance" in parts, f"{family.kind}-damping" in parts
    stiff = family.kind == "structural" and "alternating" in parts
    displace = make_displace_row(compiler, real, axes, soft, damped, stiff and soft and down == 0)
    constants_of_even = reader(CONSTANTS, compiler.compiled, f"constraint_{family.kind}_")
    constants_of_odd = reader(CONSTANTS, compiler.compiled, "constraint_stiff_") if stiff else constants_of_even
    at = displacement_triples(parts)
    first_triple, idle = at[family.name], at["idle"]
    near_lane, far_lane, planes = max(0, -right), max(0, right), len(FAMILIES)

    @compiler.compiled
    def lead(i, stores, source, turn, later, scratch, sheet):
        memory, places, parameters, row_places = sheet.memory, sheet.places, sheet.parameters, sheet.row_places
        stride, plane, width = places[P_STRIDE], places[P_PLANE], places[P_SCRATCH_WIDTH]
        row = min(i + down, places[P_ROWS] - 1)  # below the last row there is none: reciprocals are 0
        first, second = source + i * stride + near_lane, source + row * stride + far_lane
        old = places[P_BEFORE] - source if damped else np.int64(0)
        triple = first_triple + i % (down + 1)
        here = row_at(memory, places[P_MULTIPLIERS] + (number + turn * planes) * plane + i * stride)
        there = row_at(memory, places[P_MULTIPLIERS] + (number + (1 - turn) * planes) * plane + i * stride)
        if not stores:
            there = row_at(scratch, edge(idle, 0, width))
        even, odd = constants_of_even(parameters), constants_of_odd(parameters)
        constants = odd if down > 0 and i & 1 else even
        displace(
            places[P_BLOCKS], row_at(memory, first), row_at(memory, first + plane), row_at(memory, first + 2 * plane),
            row_at(memory, second), row_at(memory, second + plane), row_at(memory, second + 2 * plane),
            row_at(memory, old + first), row_at(memory, old + first + plane), row_at(memory, old + first + 2 * plane),
            row_at(memory, old + second), row_at(memory, old + second + plane), row_at(memory, old + second + 2 * plane),
            here, later, there, row_at(memory, row_places[2 + number, i]), constants.rest,
            constants.compliance, odd.compliance, constants.damping,
            row_at(scratch, edge(triple, 0, width) + SPAN), row_at(scratch, edge(triple, 1, width) + SPAN),
            row_at(scratch, edge(triple, 2, width) + SPAN),
        )  # fmt: skip

    return lead


def make_gather_row(compiler: Compiler, real: Real, parts: frozenset[str], uneven: bool) -> Callable:
    """Make gather(blocks, position, weights, valences, displacements of ten rows, out): one axis of a row. A row of
    displacements begins REACH columns before the sheet's first one."""
    formulas, block = compiler.formulas(distance, real), block_of(real)
    gathered, averaged = formulas.gathered, formulas.averaged
    has_structural, has_shear, has_bending = (kind in parts for kind in ("structural", "shear", "bending"))
    in_the_mean = "averaged-jacobi" in parts
    zero, one = real(0), real(1)

    def gather(
        blocks, position, weights, valences, across, down, above, falling, falling_above, rising, rising_above, far_across,
        far_down, far_above, out,
    ):  # fmt: skip
        for k in range(SPAN, blocks * block + SPAN):
            total = zero
            if has_structural:
                total = (across[k - 1] - across[k]) + (above[k] - down[k])
            if has_shear:
                shear = (falling_above[k - 1] - falling[k]) + (rising_above[k] - rising[k - 1])
                total = total + shear if has_structural else shear
            if has_bending:
                bending = (far_across[k - 2] - far_across[k]) + (far_above[k] - far_down[k])
                total = total + bending if has_structural or has_shear else bending
            j = k - SPAN
            weight = weights[j] if uneven else one
            if in_the_mean:
                out[j] = averaged(position[j], weight, total, valences[j])
            else:
                out[j] = gathered(position[j], weight, total)

    gather.__name__ = "gather_uneven" if uneven else "gather"
    return compiler.row(gather)


def make_iterate(compiler: Compiler, real: Real, axes: int, parts: frozenset[str], several: bool) -> SimpleNamespace:
    """Make `open_walk(first, source, turn, later, scratch, sheet)`, called before a band's first row, and
    `iterate_row(i, source, target, turn, later, scratch, sheet)`, row by row: from the positions at `source` to those
    at `target`. See make_lead."""
    scratches, at = make_scratch(compiler, real), displacement_triples(parts)
    edge, clear, triples, compiled = scratches.edge, scratches.clear, at["count"], compiler.compiled

    @compiled
    def nothing(i, stores, source, turn, later, scratch, sheet):
        """Do nothing, for a family that the scene lacks."""

    leads = [
        make_lead(compiler, real, axes, parts, family, several, edge) if family.kind in parts else nothing
        for family in FAMILIES
    ]
    vertical, falling, rising, horizontal, far_vertical, far_horizontal = leads
    gather_even = make_gather_row(compiler, real, parts, False)
    gather_uneven = make_gather_row(compiler, real, parts, True) if parts & {"pins", "load"} else gather_even
    a_vertical, a_falling, a_rising, a_horizontal, a_far_vertical, a_far_horizontal = (
        at.get(family.name, at["idle"]) for family in FAMILIES
    )

    @compiled
    def lead_down(i, stores, source, turn, later, scratch, sheet):
        vertical(i, stores, source, turn, later, scratch, sheet)
        falling(i, stores, source, turn, later, scratch, sheet)
        rising(i, stores, source, turn, later, scratch, sheet)
        far_vertical(i, stores, source, turn, later, scratch, sheet)

    @compiled
    def open_walk(first, source, turn, later, scratch, sheet):
        if first < SPAN:
            for triple in range(triples):
                clear(scratch, np.int64(triple), sheet.places[P_SCRATCH_WIDTH])
        for i in range(max(first - SPAN, 0), first):
            lead_down(i, False, source, turn, later, scratch, sheet)

    @compiled
    def iterate_row(i, source, target, turn, later, scratch, sheet):
        memory, places, row_places, row_uneven = sheet.memory, sheet.places, sheet.row_places, sheet.row_uneven
        plane, here, width = places[P_PLANE], i * places[P_STRIDE], places[P_SCRATCH_WIDTH]
        horizontal(i, True, source, turn, later, scratch, sheet)
        far_horizontal(i, True, source, turn, later, scratch, sheet)
        lead_down(i, True, source, turn, later, scratch, sheet)
        now, before, far_now, far_before = i % 2, (i + 1) % 2, i % 3, (i + 1) % 3
        for axis in range(axes):
            row = axis * plane + here
            arguments = (
                places[P_BLOCKS], row_at(memory, source + row), row_at(memory, row_places[0, i]),
                row_at(memory, row_places[1, i]), row_at(scratch, edge(a_horizontal, axis, width)),
                row_at(scratch, edge(a_vertical + now, axis, width)), row_at(scratch, edge(a_vertical + before, axis, width)),
                row_at(scratch, edge(a_falling + now, axis, width)), row_at(scratch, edge(a_falling + before, axis, width)),
                row_at(scratch, edge(a_rising + now, axis, width)), row_at(scratch, edge(a_rising + before, axis, width)),
                row_at(scratch, edge(a_far_horizontal, axis, width)),
                row_at(scratch, edge(a_far_vertical + far_now, axis, width)),
                row_at(scratch, edge(a_far_vertical + far_before, axis, width)), row_at(memory, target + row),
            )  # fmt: skip
            if row_uneven[i]:
                gather_uneven(*arguments)
            else:
                gather_even(*arguments)

    assert AXES == 3 and axes <= AXES
    return SimpleNamespace(open_walk=open_walk, iterate_row=iterate_row)
