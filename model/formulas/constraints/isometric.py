"""Quadratic bending of a hinge, values (K of a, b, c, d, length of k at rest [m], (A_c + A_d) / 3 [m^2]): see
model/formulas/bending.py. It has three multipliers, one per axis."""

from __future__ import annotations

from softlab.model.base.variant import formula
from softlab.model.formulas.bending import (
    curvature,
    isometric_change,
    shifted,
    shortening,
    softness,
    square_sum,
)
from softlab.model.formulas.distance import reciprocal


@formula
def curvature_of(kb, kc, kd, a, b, c, d):
    """k [m], three axes. a, b, c, d: corners."""
    return (
        curvature(kb, kc, kd, b[0] - a[0], c[0] - a[0], d[0] - a[0]),
        curvature(kb, kc, kd, b[1] - a[1], c[1] - a[1], d[1] - a[1]),
        curvature(kb, kc, kd, b[2] - a[2], c[2] - a[2], d[2] - a[2]),
    )


@formula
def shift(point, weight, coefficient, change):
    return (
        shifted(point[0], weight, coefficient, change[0]),
        shifted(point[1], weight, coefficient, change[1]),
        shifted(point[2], weight, coefficient, change[2]),
    )


@formula
def project(points, before, weights, values, multipliers, constants):
    a, b, c, d = points
    wa, wb, wc, wd = weights
    ka, kb, kc, kd, rest, area = values
    compliance = softness(constants[0], area)
    inverse = reciprocal(square_sum(wa, wb, wc, wd, ka, kb, kc, kd), constants[2], compliance)
    x, y, z = curvature_of(kb, kc, kd, a, b, c, d)
    part = shortening(x, y, z, rest)
    p, q, r = multipliers
    change = (
        isometric_change(part, x, inverse, compliance, p),
        isometric_change(part, y, inverse, compliance, q),
        isometric_change(part, z, inverse, compliance, r),
    )
    moved = shift(a, wa, ka, change), shift(b, wb, kb, change), shift(c, wc, kc, change), shift(d, wd, kd, change)
    return moved, (p + change[0], q + change[1], r + change[2])
