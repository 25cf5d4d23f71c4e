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
    def restrained(a, b, max_distance):
        dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        factor = tether(squared_length(dx, dy, dz), max_distance)
        return tethered(a[0], b[0], dx, factor), tethered(a[1], b[1], dy, factor), tethered(a[2], b[2], dz, factor)

    restrained_by_all = _by_last(anchors, restrained, compiled)
    for n in range(anchors - 1, 0, -1):
        restrained_by_all = _by_next(n, restrained, restrained_by_all, compiled)

    @compiled
    def project(points, before, weights, values, multipliers, constants):
        return (restrained_by_all(points[0], points, values),), multipliers

    return SimpleNamespace(project=project)


def _by_last(n, restrained, compiled):
    @compiled
    def last(a, points, values):
        return restrained(a, points[n], values[n - 1])

    return last


def _by_next(n, restrained, others, compiled):
    @compiled
    def one_and_others(a, points, values):
        return others(restrained(a, points[n], values[n - 1]), points, values)

    return one_and_others
