"""Distance |b - a|, values (rest length [m],): see model/formulas/distance.py."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain
from softlab.model.formulas.distance import make as make_distance


def make(real, compiled=plain, soft=True, damped=False, per_constraint=False):
    """Make `project`. `soft`: the constraint has a compliance and therefore a multiplier; `damped`: it also has a
    damper; `per_constraint`: each constraint has its compliance after its rest length, instead of a shared one.
    """
    formulas = make_distance(real, compiled)
    squared_length, reciprocal, moved = formulas.squared_length_3d, formulas.reciprocal, formulas.moved
    rigid_change, soft_change, damped_change = formulas.rigid_change, formulas.soft_change, formulas.damped_change
    along_3d = formulas.along_3d

    @compiled
    def shifted(point, weight, scale, dx, dy, dz):
        x, y, z = point
        return moved(x, weight, scale, dx), moved(y, weight, scale, dy), moved(z, weight, scale, dz)

    @compiled
    def project(points, before, weights, values, multipliers, constants):
        a, b = points
        first, second = weights
        compliance, damping, stiffening = constants
        rest, multiplier = values[0], multipliers[0]
        if per_constraint:
            compliance = values[1]
        dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        squared = squared_length(dx, dy, dz)
        inverse = reciprocal(first + second, stiffening, compliance)
        if damped:
            p, q = before
            ex, ey, ez = dx - (q[0] - p[0]), dy - (q[1] - p[1]), dz - (q[2] - p[2])
            along, passed = along_3d(dx, dy, dz, ex, ey, ez), along_3d(ex, ey, ez, ex, ey, ez)
            change, scale = damped_change(squared, rest, inverse, compliance, multiplier, damping, along, passed)
        elif soft:
            change, scale = soft_change(squared, rest, inverse, compliance, multiplier)
        else:
            change, scale = rigid_change(squared, rest, inverse)
        ends = shifted(a, first, -scale, dx, dy, dz), shifted(b, second, scale, dx, dy, dz)
        return ends, (multiplier + change,)

    return SimpleNamespace(project=project)
