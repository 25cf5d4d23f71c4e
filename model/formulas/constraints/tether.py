"""A long-range attachment of a to its anchor b, values (reach [m],): see model/formulas/distance.py. It has no multiplier,
and moves a alone."""

from __future__ import annotations

from types import SimpleNamespace

from model.formulas import plain
from model.formulas.distance import make as make_distance


def make(real, compiled=plain):
    """See the package."""
    formulas = make_distance(real, compiled)
    tether, tethered, squared_length = formulas.tether, formulas.tethered, formulas.squared_length_3d

    @compiled
    def project(points, before, weights, values, multipliers, constants):
        a, b = points
        dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        factor = tether(squared_length(dx, dy, dz), values[0])
        held = tethered(a[0], b[0], dx, factor), tethered(a[1], b[1], dy, factor), tethered(a[2], b[2], dz, factor)
        return (held, b), multipliers

    return SimpleNamespace(project=project)
