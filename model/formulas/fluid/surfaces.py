"""Distance of a particle from a collider made from a mesh, for the collider's contribution to the density.

It is computed in the collider's own frame (model/formulas/frame.py). For a mesh: the nearest point of all triangles, on
either side. For a field: the interpolated distance; beyond half a cell from the ends of its grid, the distance at the
nearest point there plus the distance to that point.
"""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace

import numpy as np

from softlab.model.formulas import plain
from softlab.model.formulas.cloth import make as make_cloth
from softlab.model.formulas.distance_field import NULL, make_field
from softlab.model.formulas.frame import make as make_frame
from softlab.model.formulas.lengths import make as make_lengths
from softlab.model.formulas.motion import make as make_motion
from softlab.model.formulas.triangle_tree import make_tree


def make(real, compiled=plain):
    """Make `mesh_collider` and `distance_field` in the arithmetic `real`.

    Both are (numbers, place, path, time, p, max_distance) -> (distance, nx, ny, nz), for a point p [m] at `time` [s]. They
    return `max_distance` [m] and no normal where the distance exceeds it or has no direction. `place`: the index in
    `numbers` at which the collider's begin; `path` as in frame.py.
    """
    frame, moved = make_frame(real, compiled), make_cloth(real, compiled).moved
    rotated, sine_cosine = frame.rotated, make_motion(real, compiled).sine_cosine
    zero, one = real(0), real(1)

    def seen(away):
        """Wrap away(numbers, place, x, y, z, max_distance), in the collider's frame, into a function in the world's frame."""

        @compiled
        def distance(numbers, place, path, time, p, max_distance):
            (ox, oy, oz), (qx, qy, qz), (ex, ey, ez), spin, turns = path
            x, y, z = p[0] - moved(ox, qx, time), p[1] - moved(oy, qy, time), p[2] - moved(oz, qz, time)
            sine, cosine = zero, one
            if spin != zero:
                sine, cosine = sine_cosine(turns * time)
                x, y, z = rotated(x, y, z, ex, ey, ez, -sine, cosine)
            length, nx, ny, nz = away(numbers, place, x, y, z, max_distance)
            if spin != zero:
                nx, ny, nz = rotated(nx, ny, nz, ex, ey, ez, sine, cosine)
            return length, nx, ny, nz

        return distance

    return SimpleNamespace(
        mesh_collider=seen(make_from_mesh(real, compiled)), distance_field=seen(make_from_field(real, compiled))
    )


def make_from_mesh(real, compiled):
    """Make away(numbers, tree, x, y, z, max_distance) -> (distance, nx, ny, nz) of a mesh, in the arithmetic `real`."""
    nearest, zero = make_tree(real, compiled).nearest, real(0)

    @compiled
    def away(numbers, tree, x, y, z, max_distance):
        squared, wx, wy, wz, place = nearest(numbers, tree, x, y, z, max_distance * max_distance)
        if place < 0 or not squared > zero:
            return max_distance, zero, zero, zero
        length = sqrt(squared)
        return length, wx / length, wy / length, wz / length

    return away


def make_from_field(real, compiled):
    """Make away(numbers, field, x, y, z, max_distance) -> (distance, nx, ny, nz) of a field, in the arithmetic `real`."""
    between, norm = make_cloth(real, compiled).between, make_lengths(real, compiled).length
    sample = make_field(real, compiled, between).sample
    zero, half, null = real(0), real(0.5), real(NULL)

    @compiled
    def clamped(x, low, cells, per_metre):
        """Coordinate clamped to half a cell within the grid, one axis."""
        return min(max(x, low + half / per_metre), low + (cells - half) / per_metre)

    @compiled
    def away(numbers, field, x, y, z, max_distance):
        field, per_metre = np.int32(field), numbers[field + 6]
        u = clamped(x, numbers[field + 3], numbers[field], per_metre)
        v = clamped(y, numbers[field + 4], numbers[field + 1], per_metre)
        w = clamped(z, numbers[field + 5], numbers[field + 2], per_metre)
        distance, nx, ny, nz = sample(numbers, field, u, v, w)
        size = norm(nx, ny, nz)
        if not size * per_metre > null:
            return max_distance, zero, zero, zero
        return distance + norm(x - u, y - v, z - w), nx / size, ny / size, nz / size

    return away
