"""Attachment of a vertex a to a place: three equations with one weight, solved at once. The compliance lets a deviate.

The place is a point p of the world, values (p [m], compliance [m/N]), or the mean of the four vertices of a tetrahedron
or the three of a triangle, with weights s that sum to 1, values (s, compliance [m/N]). C = a - p or a - sum s x. dC/dx
of each vertex is 1 or -s times the identity, so that the sum of m dx is 0 where no vertex is pinned. M. Macklin et al.,
"XPBD", MIG 2016, eq. 18, with a vector for a multiplier.
"""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.bending import softness
from softlab.model.formulas.distance import reciprocal
from softlab.model.formulas.lengths import moved

WORLD, CLOTH, BODY = 1, 4, 5  # number of corners
COUNTS = {WORLD: 4, CLOTH: 4, BODY: 5}  # values
MULTIPLIERS = 3
OPERATIONS = {WORLD: 3 + 1 + 12 + 6, CLOTH: 18 + 1 + 11 + 12 + 24, BODY: 24 + 1 + 14 + 12 + 30}


@formula
def changed(violation, compliance, multiplier, inverse):
    return (-violation - compliance * multiplier) * inverse


@formula
def changes(x, y, z, weight, compliance, multipliers):
    """Return (change of the multipliers, their new values)."""
    inverse = reciprocal(weight, 1.0, compliance)
    a = changed(x, compliance, multipliers[0], inverse)
    b = changed(y, compliance, multipliers[1], inverse)
    c = changed(z, compliance, multipliers[2], inverse)
    return (a, b, c), (multipliers[0] + a, multipliers[1] + b, multipliers[2] + c)


@formula
def to_world(points, before, weights, values, multipliers, constants):
    a = points[0]
    x, y, z = a[0] - values[0], a[1] - values[1], a[2] - values[2]
    compliance = softness(constants[0], values[3])
    change, total = changes(x, y, z, weights[0], compliance, multipliers)
    return (moved(a, weights[0], change),), total


@formula
def mean(values, p, q, r, s):
    """Weighted sum of four numbers, one axis."""
    return (values[0] * p + values[1] * q) + (values[2] * r + values[3] * s)


@formula
def to_body(points, before, weights, values, multipliers, constants):
    a, p, q, r, s = points
    x = a[0] - mean(values, p[0], q[0], r[0], s[0])
    y = a[1] - mean(values, p[1], q[1], r[1], s[1])
    z = a[2] - mean(values, p[2], q[2], r[2], s[2])
    wp, wq, wr, ws = values[0] * weights[1], values[1] * weights[2], values[2] * weights[3], values[3] * weights[4]
    weight = weights[0] + mean(values, wp, wq, wr, ws)
    change, total = changes(x, y, z, weight, softness(constants[0], values[4]), multipliers)
    ends = (
        moved(a, weights[0], change), moved(p, -wp, change), moved(q, -wq, change), moved(r, -wr, change),
        moved(s, -ws, change),
    )  # fmt: skip
    return ends, total


@formula
def mean_of_three(values, p, q, r):
    return (values[0] * p + values[1] * q) + values[2] * r


@formula
def to_cloth(points, before, weights, values, multipliers, constants):
    a, p, q, r = points
    x = a[0] - mean_of_three(values, p[0], q[0], r[0])
    y = a[1] - mean_of_three(values, p[1], q[1], r[1])
    z = a[2] - mean_of_three(values, p[2], q[2], r[2])
    wp, wq, wr = values[0] * weights[1], values[1] * weights[2], values[2] * weights[3]
    weight = weights[0] + mean_of_three(values, wp, wq, wr)
    change, total = changes(x, y, z, weight, softness(constants[0], values[3]), multipliers)
    ends = (
        moved(a, weights[0], change), moved(p, -wp, change),
        moved(q, -wq, change), moved(r, -wr, change),
    )  # fmt: skip
    return ends, total


@formula
def project(points, before, weights, values, multipliers, constants):
    """Project an attachment, see the package; FEATURE.corners: WORLD, CLOTH or BODY."""
    if FEATURE.corners == WORLD:
        return to_world(points, before, weights, values, multipliers, constants)
    if FEATURE.corners == CLOTH:
        return to_cloth(points, before, weights, values, multipliers, constants)
    return to_body(points, before, weights, values, multipliers, constants)
