"""Distance constraints as device functions: one of a colour (Gauss-Seidel). gather.py has all of a mass (Jacobi).

Both read and write quads in any array, in device memory or in a block's shared memory, by index. Gauss-Seidel moves
both ends of a constraint; no two of a colour share a mass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from softlab.gpu_backend.core.compile import inlined
from softlab.gpu_backend.core.formulas import device_formulas
from softlab.gpu_backend.core.quads import load_quad, store_quad
from softlab.model.base.tuples import reader
from softlab.model.base.types import Real
from softlab.model.contact.substep_parameters import (
    CONSTANTS,
    OF_SHEETS,
)
from softlab.model.formulas import distance, lengths
from softlab.model.position_based.plan import Family

KINDS = ("structural", "shear", "bending")


def dampers(parts: frozenset[str]) -> bool:
    """Return True if any constraint needs the distance of its ends at the start of the substep."""
    return any(f"{kind}-damping" in parts for kind in KINDS)


def compliant(parts: frozenset[str], family: Family) -> bool:
    """Return True if a family's constraints have multipliers."""
    return f"{family.kind}-compliance" in parts


@cache
def make_constants(math: str) -> Callable:
    """Make constants(parameters): for each of `OF_SHEETS` its `CONSTANTS` by name, read once."""
    inline = inlined(math)
    of_kind = [reader(CONSTANTS, inline, f"constraint_{kind}_") for kind in OF_SHEETS]
    structural, stiff, shear, bending = of_kind
    return inline(lambda record: (structural(record), stiff(record), shear(record), bending(record)))


@cache
def make_change(real: Real, math: str, parts: frozenset[str], kind: str, axes: int) -> Callable:
    """Make change(d, e, reciprocal, multiplier, rest, compliance, damping) -> (change, its scale) of one of a kind's
    constraints: d is the vector between its ends, e its change in this substep."""
    formulas = device_formulas(distance, real, math)
    rigid, soft, damped = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    products = device_formulas(lengths, real, math)
    squared_2d, squared_3d, along_3d = products.squared_length, products.squared_length_3d, products.dot
    has_compliance, has_damper = f"{kind}-compliance" in parts, f"{kind}-damping" in parts
    solid = axes == 3

    @inlined(math)
    def change(d, e, reciprocal, multiplier, rest, compliance, damping):
        (dx, dy, dz), (ex, ey, ez) = d, e
        squared = squared_3d(dx, dy, dz) if solid else squared_2d(dx, dy)
        if has_damper:
            along, passed = along_3d(dx, dy, dz, ex, ey, ez), along_3d(ex, ey, ez, ex, ey, ez)
            return damped(squared, rest, reciprocal, compliance, multiplier, damping, along, passed)
        if has_compliance:
            return soft(squared, rest, reciprocal, compliance, multiplier)
        return rigid(squared, rest, reciprocal)

    return change


@cache
def make_pair(real: Real, math: str, parts: frozenset[str], family: Family, colour: int, axes: int) -> Callable:
    """Make pair(position, before, a, b, multiplier, constants): it projects the constraint between the masses at
    indices a (the first) and b of both arrays, moves both in `position`, and returns the new multiplier."""
    kind = "stiff" if "alternating" in parts and family.kind == "structural" and colour else family.kind
    number = OF_SHEETS.index(kind)
    change_of = make_change(real, math, parts, family.kind, axes)
    formulas = device_formulas(distance, real, math)
    moved, reciprocal_of = formulas.moved, formulas.reciprocal
    has_pins, has_load, solid = "pins" in parts, "load" in parts, axes == 3
    has_damper = f"{family.kind}-damping" in parts
    zero, one, two = real(0), real(1), real(2)
    inline = inlined(math)

    @inline
    def reciprocal_between(first, second, constants_here):
        """Return the reciprocal from the weights of both ends."""
        if has_load:
            return reciprocal_of(first + second, constants_here.stiffening, constants_here.compliance)
        if has_pins:
            weight = first + second
            return constants_here.both if weight == two else constants_here.one if weight == one else zero
        return constants_here.both

    @inline
    def pair(position, before, a, b, multiplier, constants):
        constants_here = constants[number]
        p, q = load_quad(position, a), load_quad(position, b)
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        ex, ey, ez = zero, zero, zero
        if has_damper:
            old_p, old_q = load_quad(before, a), load_quad(before, b)
            ex, ey, ez = dx - (old_q[0] - old_p[0]), dy - (old_q[1] - old_p[1]), dz - (old_q[2] - old_p[2])
        reciprocal = reciprocal_between(p[3], q[3], constants_here)
        change, scale = change_of(
            (dx, dy, dz),
            (ex, ey, ez),
            reciprocal,
            multiplier,
            constants_here.rest,
            constants_here.compliance,
            constants_here.damping,
        )
        wp, wq = one, one
        if has_pins or has_load:
            wp, wq = p[3], q[3]
        pz, qz = p[2], q[2]
        if solid:
            pz, qz = moved(pz, wp, -scale, dz), moved(qz, wq, scale, dz)
        store_quad(position, a, moved(p[0], wp, -scale, dx), moved(p[1], wp, -scale, dy), pz, p[3])
        store_quad(position, b, moved(q[0], wq, scale, dx), moved(q[1], wq, scale, dy), qz, q[3])
        return multiplier + change

    return pair
