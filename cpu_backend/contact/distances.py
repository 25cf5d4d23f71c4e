"""Squared distances from the points of a grid to the nearest triangle, on all cores, for model/geometry/signed_distance.py.

Each point walks the tree of boxes as colliders do (model/formulas/triangle_tree.py). The triangle nearest to the previous
point bounds its search. A minimum does not depend on the order of its terms, so the bits do not depend on the bands.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numba
import numpy as np

from softlab.cpu_backend.core.compile import Compiler, start_threads
from softlab.cpu_backend.core.threads import core_count
from softlab.model.base.variant import routine
from softlab.model.formulas.lengths import cross, dot
from softlab.model.formulas.triangle_tree import CORNERS, NODE, SKIP, TRIANGLE


def squared_distances(
    numbers: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float, rows: slice
) -> np.ndarray:
    """Return the squared distances (rows, counts[2]) float64 [m^2] of the points low + (i, j, k) `spacing` [m], for the rows
    i counts[1] + j in `rows`, to the nearest triangle of the tree `numbers` (tree_numbers in float64)."""
    squared = np.empty((rows.stop - rows.start, counts[2]))
    place = float(low[0]), float(low[1]), float(low[2]), float(spacing)
    kernel = _kernel()
    threads = min(core_count(), int(getattr(numba.config, "NUMBA_NUM_THREADS")))  # noqa: B009 - filled at run time
    numba.set_num_threads(threads)
    kernel(threads, numbers, place, int(counts[1]), int(rows.start), squared)
    return squared


@routine
def from_edge(x, y, z, ex, ey, ez):
    """Return the squared distance to an edge e of a point at (x, y, z) from the start of e."""
    length = dot(ex, ey, ez, ex, ey, ez)
    part = min(max(dot(x, y, z, ex, ey, ez) / (length if length > 0 else 1.0), 0.0), 1.0)
    wx, wy, wz = x - part * ex, y - part * ey, z - part * ez
    return dot(wx, wy, wz, wx, wy, wz)


@routine
def from_triangle(numbers, t, px, py, pz):
    """Return the squared distance to the triangle at place t: along its normal if the point lies above it, else to
    its nearest edge."""
    ax, ay, az = numbers[t], numbers[t + 1], numbers[t + 2]
    bx, by, bz = numbers[t + 3], numbers[t + 4], numbers[t + 5]
    cx, cy, cz = numbers[t + 6], numbers[t + 7], numbers[t + 8]
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - bx, cy - by, cz - bz
    wx, wy, wz = ax - cx, ay - cy, az - cz
    ax, ay, az = px - ax, py - ay, pz - az
    bx, by, bz = px - bx, py - by, pz - bz
    cx, cy, cz = px - cx, py - cy, pz - cz
    nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
    size = dot(nx, ny, nz, nx, ny, nz)
    if size > 0:
        lx, ly, lz = cross(ux, uy, uz, ax, ay, az)
        mx, my, mz = cross(vx, vy, vz, bx, by, bz)
        ox, oy, oz = cross(wx, wy, wz, cx, cy, cz)
        if dot(nx, ny, nz, lx, ly, lz) >= 0 and dot(nx, ny, nz, mx, my, mz) >= 0 and dot(nx, ny, nz, ox, oy, oz) >= 0:
            height = dot(nx, ny, nz, ax, ay, az)
            return height * height / size
    one, other = from_edge(ax, ay, az, ux, uy, uz), from_edge(bx, by, bz, vx, vy, vz)
    return min(min(one, other), from_edge(cx, cy, cz, wx, wy, wz))


@routine
def outside(low, x, high):
    """Return the distance of x from an interval; 0 inside."""
    return max(max(low - x, x - high), 0.0)


@routine
def nearest(numbers, guess, x, y, z):
    """Return (squared distance, place) of the nearest triangle; `guess`: the place of a near one."""
    count, node = np.int64(numbers[SKIP]), np.int64(0)
    best, place = from_triangle(numbers, guess, x, y, z), guess
    while node < count:
        at = node * NODE
        dx = outside(numbers[at], x, numbers[at + 3])
        dy = outside(numbers[at + 1], y, numbers[at + 4])
        dz = outside(numbers[at + 2], z, numbers[at + 5])
        if dot(dx, dy, dz, dx, dy, dz) < best:
            triangle = np.int64(numbers[at + TRIANGLE])
            if triangle >= 0:
                t = count * NODE + triangle * CORNERS
                squared = from_triangle(numbers, t, x, y, z)
                if squared < best:
                    best, place = squared, t
            node += 1
        else:
            node = np.int64(numbers[at + SKIP])
    return best, place


@routine
def distances(band, bands, numbers, place, columns, first, squared):
    """Write the squared distances of a band of rows."""
    x, y, z, spacing = place
    rows, count = squared.shape
    start = np.int64(numbers[SKIP]) * NODE  # the first triangle
    for row in range(rows * band // bands, rows * (band + 1) // bands):
        i, j = (first + row) // columns, (first + row) % columns
        near = start
        for k in range(count):
            best, near = nearest(numbers, near, x + i * spacing, y + j * spacing, z + k * spacing)
            squared[row, k] = best
            if k == 0:
                start = near


@cache
def _kernel() -> Callable:
    start_threads()
    compiler = Compiler("of a field", "exact")
    return compiler.banded(compiler.variant_of(np.float64).copied(distances))
