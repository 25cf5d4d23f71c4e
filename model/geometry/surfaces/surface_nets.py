"""A closed surface around the inside that a function of space defines.

One vertex in each cell of a lattice that the surface passes, one quadrilateral for each edge of the lattice that it crosses:
S. F. F. Gibson, "Constrained Elastic Surface Nets", MICCAI 1998. Where two parts touch by an edge or a corner of the lattice
the gap is filled, so that every edge has two triangles: L. Latecki et al., "Well-Composed Sets", Computer Vision and Image
Understanding 61 (1995). Vertices begin at the mean of their cell's crossings and are moved onto the surface by Newton's
method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot, norm

# points (n, 3) [m] -> (n,), under 0 inside, about a distance [m] near the surface
Field = Callable[[np.ndarray], np.ndarray]

NEWTON = 3  # steps: the fields here are distances but for their blends
STEP = 2.0**-10  # of a cell: for gradients
JUST = 2.0**-5  # cells: how far inside a point is that was put there, and how far outside one that lies on the surface
MARGIN = 2.0**-6  # cells: how near to its cell's sides a vertex may come, so that no two meet


def surface(field: Field, low: np.ndarray, high: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (position (vertices, 3) float64 [m], triangles (n, 3) int32): outer sides outwards, about `cell` [m] to an
    edge.

    `field` must be over 0 on the sides of the box from `low` to `high` (3,) [m], which is widened to whole cells.
    """
    counts = np.ceil((high - low) / cell).astype(np.int64) + 2
    origin = (low + high) / 2 - (counts - 1) / 2 * cell
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1)
    value = field(origin + nodes.reshape(-1, 3) * cell).reshape(tuple(counts))
    value[np.abs(value) < JUST * cell] = JUST * cell  # on a face along the lattice rounding would choose sides
    _compose(value, JUST * cell)
    inside = value < 0
    place, passes = np.zeros((*(counts - 1), 3)), np.zeros(tuple(counts - 1))
    for axis in range(3):  # crossings of edges along each axis, handed to the four cells about each
        near, far = _along(value, axis)
        crossed = (near < 0) != (far < 0)
        part = np.divide(near, near - far, out=np.zeros_like(near), where=crossed)
        for corner in np.ndindex(2, 2):
            shift = np.insert(np.array(corner), axis, 0)
            some = tuple(slice(s, s + n) for s, n in zip(shift, counts - 1, strict=True))
            passes += crossed[some]
            for other in range(3):
                place[..., other] += np.where(crossed[some], part[some] if other == axis else shift[other], 0.0)
    used = passes > 0
    cells = np.stack(np.nonzero(used), axis=1)
    start = origin + (cells + place[used] / passes[used][:, None]) * cell
    number = np.full(tuple(counts - 1), -1)
    number[used] = np.arange(len(cells))
    quads = np.concatenate([_quads(inside, number, axis) for axis in range(3)])
    position = _onto(field, start, origin + cells * cell, cell)
    return position, _split(position, quads)


def _compose(value: np.ndarray, depth: float) -> None:
    """Move lattice points inside, to `depth` [m] under the surface, until no two inside points of a square or a cube,
    nor two outside points, are connected by a diagonal only. Each time, the outside point nearest to the surface is
    moved."""
    while True:
        inside, wrong = value < 0, np.zeros(value.shape, dtype=bool)
        for axis in range(3):
            one, two = (k for k in range(3) if k != axis)
            (a, b), (c, d) = (_along(part, two) for part in _along(inside, one))
            _mark(wrong, value, (a == d) & (b == c) & (a != b), (0 if k == axis else 1 for k in range(3)))
        total = sum(_corner(inside.astype(np.int8), corner) for corner in np.ndindex(2, 2, 2))
        for x, y in np.ndindex(2, 2):
            near, far = _corner(inside, (0, x, y)), _corner(inside, (1, 1 - x, 1 - y))
            _mark(wrong, value, ((total == 2) & near & far) | ((total == 6) & ~near & ~far), (1, 1, 1))
        if not wrong.any():
            return
        value[wrong] = -depth


def _corner(array: np.ndarray, corner: tuple[int, ...]) -> np.ndarray:
    """Return the values at one corner of every cell."""
    return array[tuple(slice(k, k + n - 1) for k, n in zip(corner, array.shape, strict=True))]


def _mark(wrong: np.ndarray, value: np.ndarray, where: np.ndarray, extent: Iterable[int]) -> None:
    """Mark, of each block of `extent` + 1 points that begins at a place of `where`, the nearest to the surface of those
    outside."""
    shifts = np.array(list(np.ndindex(*(k + 1 for k in extent))))
    for place in np.stack(np.nonzero(where), axis=1):
        block = [tuple(point) for point in place + shifts]
        wrong[min((point for point in block if value[point] >= 0), key=lambda point: value[point])] = True


def _along(array: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the near and the far ends of the lattice's edges along an axis."""
    last = array.shape[axis]
    return np.take(array, np.arange(last - 1), axis), np.take(array, np.arange(1, last), axis)


def _quads(inside: np.ndarray, number: np.ndarray, axis: int) -> np.ndarray:
    """Return (n, 4): the vertices of the four cells about each edge along `axis` that is crossed, counter-clockwise
    from outside."""
    near, far = _along(inside, axis)
    edges = np.stack(np.nonzero(near != far), axis=1)
    out = near[tuple(edges.T)]  # the outside lies at the far end
    one, two = np.zeros(3, np.int64), np.zeros(3, np.int64)
    one[(axis + 1) % 3] = two[(axis + 2) % 3] = 1
    ring = np.stack([number[tuple((edges - shift).T)] for shift in (one + two, two, 0 * one, one)], axis=1)
    return np.where(out[:, None], ring, ring[:, ::-1])


def _split(position: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Return (2 n, 3) int32: each quadrilateral along its shorter diagonal."""
    a, b, c, d = quads.T
    first = norm(position[a] - position[c]) <= norm(position[b] - position[d])
    one = np.where(first[:, None], np.stack([a, b, c], 1), np.stack([b, c, d], 1))
    two = np.where(first[:, None], np.stack([a, c, d], 1), np.stack([b, d, a], 1))
    return np.stack([one, two], axis=1).reshape(-1, 3).astype(np.int32)


def _onto(field: Field, start: np.ndarray, corner: np.ndarray, cell: float) -> np.ndarray:
    """Return positions (n, 3) on the surface, or as near as possible, each in the cell with the given lowest corner."""
    position, step = start.copy(), STEP * cell
    for _ in range(NEWTON):
        value = field(position)
        slope = np.stack([(field(position + d) - field(position - d)) / (2 * step) for d in step * np.eye(3)], axis=1)
        square = dot(slope, slope)
        # of a blend's ridge the slope may vanish; a field about as steep as a distance has a square of about 1
        position -= np.where(square > 0.01, value / np.maximum(square, 0.01), 0.0)[:, None] * slope
        position = corner + np.clip(position - corner, MARGIN * cell, (1 - MARGIN) * cell)
    return position
