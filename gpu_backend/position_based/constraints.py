"""Distance constraints as device functions: one of a colour (Gauss-Seidel). gather.py has all of a mass (Jacobi).

Both read and write quads in any array, in device memory or in a block's shared memory, by index. Gauss-Seidel moves
both ends of a constraint; no two of a colour share a mass.
"""

from __future__ import annotations

from typing import Any

from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.variant import FEATURE, features_of, inlined_routine, unrolled
from softlab.model.contact.substep_parameters import CONSTANTS, NAMES, OF_SHEETS, Constants
from softlab.model.formulas.distance import damped_change, moved, rigid_change, soft_change
from softlab.model.formulas.distance import reciprocal as reciprocal_of
from softlab.model.formulas.lengths import dot, squared_length, squared_length_3d
from softlab.model.position_based.plan import Family

KINDS = ("structural", "shear", "bending")
NAMES_OF_SHEETS, SHEETS, NUMBERS = tuple(NAMES[kind] for kind in OF_SHEETS), len(OF_SHEETS), len(CONSTANTS)


def dampers(parts: frozenset[str]) -> bool:
    """Return True if any constraint needs the distance of its ends at the start of the substep."""
    return any(f"{kind}-damping" in parts for kind in KINDS)


def compliant(parts: frozenset[str], family: Family) -> bool:
    """Return True if a family's constraints have multipliers."""
    return f"{family.kind}-compliance" in parts


@inlined_routine
def constants_of(parameters):
    """Return the constants of each of OF_SHEETS. A loop keeps those in registers, and would read the record again after
    each barrier."""
    return tuple(
        Constants(*tuple(parameters[NAMES_OF_SHEETS[kind][n]] for n in unrolled(NUMBERS))) for kind in unrolled(SHEETS)
    )


def kind_features(parts: frozenset[str], kind: str, axes: int) -> dict[str, Any]:
    """Return the features of one kind of constraints."""
    return features_of(parts) | {
        "axes": axes, "soft": f"{kind}-compliance" in parts, "damped": f"{kind}-damping" in parts,
        "constants": OF_SHEETS.index(kind),
    }  # fmt: skip


def family_features(parts: frozenset[str], family: Family, colour: int, axes: int) -> dict[str, Any]:
    """Return the features of one colour of a family of constraints."""
    stiff = "alternating" in parts and family.kind == "structural" and colour
    return kind_features(parts, family.kind, axes) | {
        "constants": OF_SHEETS.index("stiff" if stiff else family.kind), "colour": int(colour),
        "rows_down": family.rows, "columns_along": abs(family.columns), "rising": family.columns < 0,
    }  # fmt: skip


@inlined_routine
def change(d, e, reciprocal, multiplier, rest, compliance, damping):
    """Return (change, its scale) of a constraint: d is the vector between its ends, e its change in this substep."""
    (dx, dy, dz), (ex, ey, ez) = d, e
    squared = squared_length_3d(dx, dy, dz) if FEATURE.axes == 3 else squared_length(dx, dy)
    if FEATURE.damped:
        along, passed = dot(dx, dy, dz, ex, ey, ez), dot(ex, ey, ez, ex, ey, ez)
        return damped_change(squared, rest, reciprocal, compliance, multiplier, damping, along, passed)
    if FEATURE.soft:
        return soft_change(squared, rest, reciprocal, compliance, multiplier)
    return rigid_change(squared, rest, reciprocal)


@inlined_routine
def reciprocal_between(first, second, constants):
    """Return the reciprocal from the weights of both ends."""
    if FEATURE.load:
        return reciprocal_of(first + second, constants.stiffening, constants.compliance)
    if FEATURE.pins:
        weight = first + second
        return constants.both if weight == 2.0 else constants.one if weight == 1.0 else 0.0
    return constants.both


@inlined_routine
def pair(position, before, a, b, multiplier, constants_of_kinds):
    """Project the constraint between the masses at indices a (the first) and b of both arrays: move both in `position`.
    Return the new multiplier."""
    number = FEATURE.constants
    constants = constants_of_kinds[number]
    p, q = load_quad(position, a), load_quad(position, b)
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    ex, ey, ez = 0.0, 0.0, 0.0
    if FEATURE.damped:
        old_p, old_q = load_quad(before, a), load_quad(before, b)
        ex, ey, ez = dx - (old_q[0] - old_p[0]), dy - (old_q[1] - old_p[1]), dz - (old_q[2] - old_p[2])
    reciprocal = reciprocal_between(p[3], q[3], constants)
    added, scale = change(
        (dx, dy, dz), (ex, ey, ez), reciprocal, multiplier, constants.rest, constants.compliance, constants.damping
    )
    wp, wq = 1.0, 1.0
    if FEATURE.pins or FEATURE.load:
        wp, wq = p[3], q[3]
    pz, qz = p[2], q[2]
    if FEATURE.axes == 3:
        pz, qz = moved(pz, wp, -scale, dz), moved(qz, wq, scale, dz)
    store_quad(position, a, moved(p[0], wp, -scale, dx), moved(p[1], wp, -scale, dy), pz, p[3])
    store_quad(position, b, moved(q[0], wq, scale, dx), moved(q[1], wq, scale, dy), qz, q[3])
    return multiplier + added
