"""Points of a lattice inside a closed mesh, by winding numbers along its columns.

Each triangle is scan converted: rows from the heights of its corners, columns from where its sides cross a row, each side
counted from the same end for both triangles beside it. Both are whole numbers that neighbours share, so that they tile the
columns without gap or overlap (the half-open rule of J. D. Foley et al., "Computer Graphics", section 3.6) and a closed
mesh leaves every column as often as it enters it, however its corners lie. A point is inside where the winding number is
over 0: parts that overlap count once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.lists import ranges

BATCH = 1 << 20  # points at once


@dataclass(frozen=True)
class Runs:
    """The lattice points inside a mesh, as runs along z: run r has the points (x, y, low) to (x, y, high - 1).

    int64 (runs,), by x, y, low; point (i, j, k) lies at `origin` + (i, j, k) `pitch` [m]. `least` and `most`: smallest
    and largest winding number at lattice points; 0 and 1 for a mesh that does not overlap itself.
    """

    x: np.ndarray
    y: np.ndarray
    low: np.ndarray
    high: np.ndarray
    origin: np.ndarray
    pitch: float
    least: int
    most: int

    @property
    def count(self) -> int:
        """Number of points."""
        return int((self.high - self.low).sum())

    def points(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield (index (n, 3) int64, position (n, 3) float64 [m]), in order, some BATCH at a time."""
        length = self.high - self.low
        ends = np.cumsum(length)
        begin = 0
        while begin < len(length):
            before = int(ends[begin] - length[begin])
            end = max(begin + 1, int(np.searchsorted(ends, before + BATCH, "right")))
            some = slice(begin, end)
            run, along = ranges(self.low[some], length[some])
            index = np.stack([self.x[some][run], self.y[some][run], along], axis=1)
            yield index, self.origin + index * self.pitch
            begin = end


Lattice = tuple[np.ndarray, np.ndarray]


def lattice(position: np.ndarray, pitch: float) -> Lattice:
    """Return (origin (3,) [m], counts (3,) int64) of the lattice of `pitch` [m] that lies evenly in the box around
    `position` (vertices, 3): as many points along each axis as pitches fit, rounded, at least one; of a box of whole
    pitches the centres of its cells."""
    low, high = position.min(axis=0), position.max(axis=0)
    counts = np.maximum(1, np.floor((high - low) / pitch + 0.5)).astype(np.int64)
    return (low + high) / 2 - (counts - 1) / 2 * pitch, counts


def divided(position: np.ndarray, pitch: float, parts: int) -> Lattice:
    """`lattice(position, pitch)` with an odd number of `parts` to each pitch, and a pitch more on all sides.

    The old points are among its points and none lies halfway between two of them, so that each is nearest to one: no
    weight depends on a tie, which would be decided the same way everywhere.
    """
    origin, counts = lattice(position, pitch)
    return origin - pitch, (counts + 1) * parts + 1


def runs_inside(position: np.ndarray, triangles: np.ndarray, pitch: float, place: Lattice | None = None) -> Runs:
    """Return the points of a lattice, `lattice(position, pitch)` unless given, inside a mesh: `position` (vertices, 3)
    [m] and `triangles` (n, 3), closed, outer sides outwards."""
    origin, counts = lattice(position, pitch) if place is None else place
    row, column, height, sign, _ = crossings((position - origin) / pitch, np.asarray(triangles, dtype=np.int64), counts)
    level = np.clip(np.ceil(height), -1, counts[2] + 1).astype(np.int64)  # the first point at or above the crossing
    line = column * counts[1] + row
    order = np.lexsort((level, line))
    line, level = line[order], level[order]
    # of a column all signs add up to 0: what is summed up to a crossing is what lies below it, with the other sign
    winding = -np.cumsum(sign[order])[:-1]
    same = line[1:] == line[:-1]
    low, high = np.clip(level[:-1], 0, counts[2]), np.clip(level[1:], 0, counts[2])
    seen = same & (low < high)
    inside = seen & (winding > 0)
    x, y = np.divmod(line[:-1][inside], counts[1])
    low, high = low[inside], high[inside]
    touching = (x[1:] == x[:-1]) & (y[1:] == y[:-1]) & (low[1:] == high[:-1])
    begins, ends = np.concatenate([[True], ~touching])[: len(x)], np.concatenate([~touching, [True]])[: len(x)]
    return Runs(
        x[begins],
        y[begins],
        low[begins],
        high[ends],
        origin,
        pitch,
        int(winding[seen].min(initial=0)),
        int(winding[seen].max(initial=0)),
    )


def crossings(
    place: np.ndarray, triangles: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (row, column, height, sign, triangle) (n,), int64 but for the heights: the crossings of triangles with
    columns; `place` (vertices, 3): vertices, in pitches from the lattice's origin. Sign: +1 if the outer side faces
    up."""
    above = np.clip(np.ceil(place[:, 1]), 0, counts[1]).astype(np.int64)  # the first row at or above each vertex
    corner = above[triangles]
    first, last = corner.min(axis=1), corner.max(axis=1)
    number, row = ranges(first, last - first)
    x, z = np.empty((2, 2, len(number)))  # where the side going down, and the one going up, cross
    for k in range(3):
        start, end = triangles[number, k], triangles[number, (k + 1) % 3]
        one, two = np.minimum(start, end), np.maximum(start, end)
        for going, passes in enumerate(
            ((above[end] <= row) & (row < above[start]), (above[start] <= row) & (row < above[end]))
        ):
            a, b = place[one[passes]], place[two[passes]]
            part = np.clip((row[passes] - a[:, 1]) / (b[:, 1] - a[:, 1]), 0, 1)
            x[going, passes] = a[:, 0] + part * (b[:, 0] - a[:, 0])
            z[going, passes] = a[:, 2] + part * (b[:, 2] - a[:, 2])
    edge = np.clip(np.ceil(x), 0, counts[0]).astype(np.int64)
    left, right = edge.min(axis=0), edge.max(axis=0)
    sign = np.where(edge[0] < edge[1], 1, -1)
    side, column = ranges(left, right - left)
    across = x[1, side] - x[0, side]
    part = np.divide(column - x[0, side], across, out=np.zeros(len(side)), where=across != 0)
    height = z[0, side] + np.clip(part, 0, 1) * (z[1, side] - z[0, side])
    return row[side], column, height, sign[side], number[side]


def winding_numbers(points: np.ndarray, position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (points,) float64: how often the mesh goes round each of `points` (n, 3): whole numbers of a closed mesh.

    Solid angles: A. Van Oosterom, J. Strackee, "The Solid Angle of a Plane Triangle", IEEE Trans. Biomed. Eng. 30 (1983).
    Takes points x triangles; for whole lattices there is `runs_inside`.
    """
    total = np.zeros(len(points))
    corners = np.ascontiguousarray(position[triangles].transpose(1, 2, 0))[:, :, None]  # an axis is a row
    step = max(1, BATCH // 8 // max(1, len(triangles)))
    for begin in range(0, len(points), step):
        a, b, c = corners - points[begin : begin + step].T[:, :, None]
        la, lb, lc = (np.sqrt(_dot(side, side)) for side in (a, b, c))
        normal = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
        volume = a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2]
        angle = np.arctan2(volume, la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb)
        total[begin : begin + step] = angle.sum(axis=1) / (2 * np.pi)
    return total


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    total: np.ndarray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return total
