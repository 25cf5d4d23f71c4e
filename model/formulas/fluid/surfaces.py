"""Distance of a particle from a collider made from a mesh, for the collider's contribution to the density.

It is computed in the collider's own frame (model/formulas/frame.py). For a mesh: the nearest point of all triangles, on
either side. For a field: the interpolated distance; beyond half a cell from the ends of its grid, the distance at the
nearest point there plus the distance to that point.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from softlab.model.base.variant import Open, filled, formula
from softlab.model.formulas.cloth import moved
from softlab.model.formulas.distance_field import NULL, sample
from softlab.model.formulas.frame import rotated
from softlab.model.formulas.lengths import length
from softlab.model.formulas.motion import sine_cosine
from softlab.model.formulas.triangle_tree import nearest

away = Open("away(numbers, place, x, y, z, max_distance) -> (distance, nx, ny, nz), in the collider's frame")


@formula
def seen(numbers, place, path, time, p, max_distance):
    """Return (distance, nx, ny, nz) of a point p [m] at `time` [s] from a collider; `max_distance` [m] and no normal
    where the distance exceeds it or has no direction.

    `place`: the index in `numbers` at which the collider's begin; `path` as in frame.py.
    """
    (ox, oy, oz), (qx, qy, qz), (ex, ey, ez), spin, turns = path
    x, y, z = p[0] - moved(ox, qx, time), p[1] - moved(oy, qy, time), p[2] - moved(oz, qz, time)
    sine, cosine = 0.0, 1.0
    if spin != 0.0:
        sine, cosine = sine_cosine(turns * time)
        x, y, z = rotated(x, y, z, ex, ey, ez, -sine, cosine)
    length, nx, ny, nz = away(numbers, place, x, y, z, max_distance)
    if spin != 0.0:
        nx, ny, nz = rotated(nx, ny, nz, ex, ey, ez, sine, cosine)
    return length, nx, ny, nz


@formula
def away_from_mesh(numbers, tree, x, y, z, max_distance):
    squared, wx, wy, wz, place = nearest(numbers, tree, x, y, z, max_distance * max_distance)
    if place < 0 or not squared > 0.0:
        return max_distance, 0.0, 0.0, 0.0
    length = sqrt(squared)
    return length, wx / length, wy / length, wz / length


@formula
def clamped(x, low, cells, per_metre):
    """Coordinate clamped to half a cell within the grid, one axis."""
    return min(max(x, low + 0.5 / per_metre), low + (cells - 0.5) / per_metre)


@formula
def away_from_field(numbers, field, x, y, z, max_distance):
    field, per_metre = np.int32(field), numbers[field + 6]
    u = clamped(x, numbers[field + 3], numbers[field], per_metre)
    v = clamped(y, numbers[field + 4], numbers[field + 1], per_metre)
    w = clamped(z, numbers[field + 5], numbers[field + 2], per_metre)
    distance, nx, ny, nz = sample(numbers, field, u, v, w)
    size = length(nx, ny, nz)
    if not size * per_metre > NULL:
        return max_distance, 0.0, 0.0, 0.0
    return distance + length(x - u, y - v, z - w), nx / size, ny / size, nz / size


mesh_collider = filled(seen, {"away": away_from_mesh})
distance_field = filled(seen, {"away": away_from_field})
