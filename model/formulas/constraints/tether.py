"""Long-range attachments of a particle a to its anchors, values (maximum distance [m] to each): see
model/formulas/distance.py. They have no multipliers and move only a; the anchors are applied one after the other."""

from __future__ import annotations

from types import SimpleNamespace

from softlab.model.formulas import plain
from softlab.model.formulas.distance import make as make_distance


def make(real, compiled=plain, anchors=1):
    """Make `project`. `anchors`: anchors per particle."""
    formulas = make_distance(real, compiled)
    tether, tethered, squared_length = formulas.tether, formulas.tethered, formulas.squared_length_3d

    @compiled
    def held_by(a, b, reach):
        dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        factor = tether(squared_length(dx, dy, dz), reach)
        return tethered(a[0], b[0], dx, factor), tethered(a[1], b[1], dy, factor), tethered(a[2], b[2], dz, factor)

    held = _by_last(anchors, held_by, compiled)
    for n in range(anchors - 1, 0, -1):
        held = _by_next(n, held_by, held, compiled)

    @compiled
    def project(points, before, weights, values, multipliers, constants):
        return (held(points[0], points, values),), multipliers

    return SimpleNamespace(project=project)


def _by_last(n, held_by, compiled):
    @compiled
    def last(a, points, values):
        return held_by(a, points[n], values[n - 1])

    return last


def _by_next(n, held_by, others, compiled):
    @compiled
    def one_and_others(a, points, values):
        return others(held_by(a, points[n], values[n - 1]), points, values)

    return one_and_others
