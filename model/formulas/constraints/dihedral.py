"""Angle of a hinge, values (edge at rest [m], tan(theta/4) at rest, (A_c + A_d) / 3 [m^2]): see
model/formulas/bending.py."""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.bending import (
    by_ends,
    dihedral_change,
    gradient_sum,
    hinge,
    shift,
    softness,
    steepness,
)
from softlab.model.formulas.distance import reciprocal
from softlab.model.formulas.lengths import dot


@formula
def project(points, before, weights, values, multipliers, constants):
    a, b, c, d = points
    wa, wb, wc, wd = weights
    edge, rest, area = values
    t, cx, cy, cz, dx, dy, dz, along_c, along_d = hinge(
        b[0] - a[0], b[1] - a[1], b[2] - a[2], c[0] - a[0], c[1] - a[1], c[2] - a[2], d[0] - a[0], d[1] - a[1],
        d[2] - a[2],
    )  # fmt: skip
    ax, bx = by_ends(along_c, along_d, cx, dx)
    ay, by = by_ends(along_c, along_d, cy, dy)
    az, bz = by_ends(along_c, along_d, cz, dz)
    steep = steepness(edge, t)
    weight = gradient_sum(
        steep, wa, wb, wc, wd, dot(ax, ay, az, ax, ay, az), dot(bx, by, bz, bx, by, bz),
        dot(cx, cy, cz, cx, cy, cz), dot(dx, dy, dz, dx, dy, dz),
    )  # fmt: skip
    compliance = softness(constants[0], area)
    inverse = reciprocal(weight, constants[2], compliance)
    multiplier = multipliers[0]
    change, scale = dihedral_change(edge, t, rest, steep, inverse, compliance, multiplier)
    moved = (
        shift(a, wa, ax, ay, az, scale), shift(b, wb, bx, by, bz, scale), shift(c, wc, cx, cy, cz, scale),
        shift(d, wd, dx, dy, dz, scale),
    )  # fmt: skip
    return moved, (multiplier + change,)
