"""Distance |b - a|, values (rest length [m],): see model/formulas/distance.py."""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.distance import damped_change, moved, reciprocal, rigid_change, soft_change
from softlab.model.formulas.lengths import dot, squared_length_3d


@formula
def shifted(point, weight, scale, dx, dy, dz):
    x, y, z = point
    return moved(x, weight, scale, dx), moved(y, weight, scale, dy), moved(z, weight, scale, dz)


@formula
def project(points, before, weights, values, multipliers, constants):
    a, b = points
    first, second = weights
    compliance, damping, stiffening = constants
    rest, multiplier = values[0], multipliers[0]
    if FEATURE.per_constraint:
        compliance = values[1]
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    squared = squared_length_3d(dx, dy, dz)
    inverse = reciprocal(first + second, stiffening, compliance)
    if FEATURE.damped:
        p, q = before
        ex, ey, ez = dx - (q[0] - p[0]), dy - (q[1] - p[1]), dz - (q[2] - p[2])
        along, passed = dot(dx, dy, dz, ex, ey, ez), dot(ex, ey, ez, ex, ey, ez)
        change, scale = damped_change(squared, rest, inverse, compliance, multiplier, damping, along, passed)
    elif FEATURE.soft:
        change, scale = soft_change(squared, rest, inverse, compliance, multiplier)
    else:
        change, scale = rigid_change(squared, rest, inverse)
    ends = shifted(a, first, -scale, dx, dy, dz), shifted(b, second, scale, dx, dy, dz)
    return ends, (multiplier + change,)
