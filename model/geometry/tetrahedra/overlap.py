"""Which triangles pass through which voxels of a lattice, by separating axes, from coarse cells to fine ones.

Voxels are open: a triangle that only touches a side of a voxel is not in it. So a box whose sides lie on the lattice
marks none of the voxels around it.
"""

from __future__ import annotations

import numpy as np

BATCH = 1 << 16  # triangles at once
NEARLY = 1 - 1e-12  # of a cell's reach along an axis: what touches it to rounding touches it
PARALLEL = 1e-9  # an axis across an edge that is this much shorter than the edge has no direction
EIGHT = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])


def triangles_in_voxels(place: np.ndarray, triangles: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (triangle (pairs,), voxel (pairs, 3)) int64, by triangle: each of `triangles` (n, 3) with the voxels that
    it passes through, (i, j, k) being the cube from there to (i + 1, j + 1, k + 1). `place` (vertices, 3): in voxels,
    within 0 and `counts` (3,)."""
    batches = [
        _some(begin, place[triangles[begin : begin + BATCH]], counts) for begin in range(0, len(triangles), BATCH)
    ]
    number, cell = np.concatenate([pair[0] for pair in batches]), np.concatenate([pair[1] for pair in batches])
    order = np.lexsort((cell[:, 2], cell[:, 1], cell[:, 0], number))
    return number[order], cell[order]


def _some(first: int, corners: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of triangles `corners` (n, 3, 3), which are numbered from `first` on."""
    least = np.clip(np.floor(corners.min(axis=1)), 0, counts - 1).astype(np.int64)
    most = np.clip(np.ceil(corners.max(axis=1)) - 1, least, counts - 1).astype(np.int64)
    level = np.zeros(
        len(corners), dtype=np.int64
    )  # the finest at which a triangle spans two cells at most along an axis
    while (wide := ((most >> level[:, None]) - (least >> level[:, None]) > 1).any(axis=1)).any():
        level[wide] += 1
    number, cell = np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
    for size in range(int(level.max(initial=0)), -1, -1):
        number, cell = np.repeat(number, 8), (2 * cell[:, None] + EIGHT).reshape(-1, 3)
        begin = np.flatnonzero(level == size)
        new = ((least[begin] >> size)[:, None] + EIGHT).reshape(-1, 3)
        number, cell = np.concatenate([number, np.repeat(begin, 8)]), np.concatenate([cell, new])
        near = ((cell >= least[number] >> size) & (cell <= most[number] >> size)).all(axis=1)
        number, cell = number[near], cell[near]
        half = 2.0**size / 2
        overlapping = _overlaps_cube(corners[number] - (cell * 2.0**size + half)[:, None], half)
        number, cell = number[overlapping], cell[overlapping]
    return number + first, cell


def _overlaps_cube(corners: np.ndarray, half: float) -> np.ndarray:
    """Return (n,) bool: True if a triangle of `corners` (n, 3, 3) has a point in the open cube of side 2 `half` at the
    origin.

    Two convex bodies are apart where one of 13 axes separates them: S. Gottschalk, M. C. Lin, D. Manocha, "OBBTree", SIGGRAPH
    1996; T. Akenine-Moeller, "Fast 3D Triangle-Box Overlap Testing", Journal of Graphics Tools 6 (2001).
    """
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))  # (3, n) each: an axis is a row
    overlapping = np.ones(len(corners), dtype=bool)
    for x, y, z in zip(a, b, c, strict=True):
        overlapping &= (np.minimum(np.minimum(x, y), z) < half) & (np.maximum(np.maximum(x, y), z) > -half)
    one, two = b - a, c - a
    normal = np.stack([one[(k + 1) % 3] * two[(k + 2) % 3] - one[(k + 2) % 3] * two[(k + 1) % 3] for k in range(3)])
    extent = half * NEARLY * np.abs(normal).sum(axis=0)
    overlapping &= (np.abs((normal * a).sum(axis=0)) < extent) | (extent == 0)
    for edge, start, other in ((one, a, c), (two, a, b), (c - b, b, a)):
        size = np.abs(edge).sum(axis=0)
        for k in range(3):
            y, z = (k + 1) % 3, (k + 2) % 3  # the axis is the unit vector k times the edge: (-edge z, edge y)
            across = np.abs(edge[y]) + np.abs(edge[z])
            extent = half * NEARLY * across
            p = edge[y] * start[z] - edge[z] * start[y]
            q = edge[y] * other[z] - edge[z] * other[y]
            apart = (np.minimum(p, q) >= extent) | (np.maximum(p, q) <= -extent)
            overlapping &= ~apart | (across <= PARALLEL * size)
    return overlapping
