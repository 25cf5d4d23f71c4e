"""Long-range attachments of a particle a to its anchors, values (maximum distance [m] to each): see
model/formulas/distance.py. They have no multipliers and move only a; the anchors are applied one after the other."""

from __future__ import annotations

from softlab.model.base.variant import FEATURE, formula
from softlab.model.formulas.distance import tether, tethered
from softlab.model.formulas.lengths import squared_length_3d


@formula
def restrained(a, b, max_distance):
    dx, dy, dz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    factor = tether(squared_length_3d(dx, dy, dz), max_distance)
    return tethered(a[0], b[0], dx, factor), tethered(a[1], b[1], dy, factor), tethered(a[2], b[2], dz, factor)


@formula
def project(points, before, weights, values, multipliers, constants):
    a = restrained(points[0], points[1], values[0])
    if FEATURE.anchors > 1:
        a = restrained(a, points[2], values[1])
    if FEATURE.anchors > 2:
        a = restrained(a, points[3], values[2])
    if FEATURE.anchors > 3:
        a = restrained(a, points[4], values[3])
    return (a,), multipliers
