"""First crossings of segments with a mesh, all segments at once in NumPy, for drawing. Masses use
model/formulas/triangle_tree.py.
"""

from __future__ import annotations

import numpy as np

from softlab.model.formulas.triangle_tree import CORNERS, NODE


def first_crossings(tree: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle that each segment from `begin` to `end` (n, 3) [m] crosses first, and its normal.

    `tree`: `tree_numbers` in float64. Returns (triangle (n,) int64, -1 where none is crossed; unit normal (n, 3), to the side
    of `begin`). A segment through an edge crosses both triangles; a point on a triangle lies before its front.
    """
    nodes, corners = _parts(tree)
    segment, triangle = _candidates(nodes, begin, end)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    p, q = begin[segment], end[segment]
    normal = np.cross(b - a, c - a)
    before, after = (((point - a) * normal).sum(axis=1) for point in (p, q))
    across = (before >= 0) != (after >= 0)
    a, b, c = a - p, b - p, c - p
    edges = np.stack([(np.cross(one, other) * (q - p)).sum(axis=1) for one, other in ((a, b), (b, c), (c, a))])
    across &= (edges.min(axis=0) >= 0) | (edges.max(axis=0) <= 0)
    segment, triangle, normal, before, after = (array[across] for array in (segment, triangle, normal, before, after))
    order = np.lexsort((triangle, before / (before - after), segment))
    crossing, first = np.unique(segment[order], return_index=True)
    nearest = order[first]
    first_triangle, side = np.full(len(begin), -1), np.zeros_like(begin)
    first_triangle[crossing] = triangle[nearest]
    length = np.where(before >= 0, 1, -1) * np.sqrt((normal**2).sum(axis=1))
    side[crossing] = normal[nearest] / length[nearest, None]
    return first_triangle, side


def corners_of(tree: np.ndarray) -> np.ndarray:
    """Return (triangles, 3, 3) [m] of a tree, in its order."""
    return _parts(tree)[1]


def _parts(tree: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (nodes (n, NODE), corners (triangles, 3, 3))."""
    count = int(tree[6])  # the root's end: how many nodes there are
    return tree[: count * NODE].reshape(count, NODE), tree[count * NODE :].reshape(-1, CORNERS // 3, 3)


def _candidates(nodes: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (segments, triangles) (pairs,) int64 whose boxes overlap, down the tree level by level."""
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    over, leaf = nodes[:, 6].astype(np.int64), nodes[:, 7].astype(np.int64)
    segment, node = np.arange(len(begin)), np.zeros(len(begin), np.int64)
    pairs = [(segment[:0], node[:0])]
    while len(segment):
        overlap = ((nodes[node, 0:3] <= high[segment]) & (nodes[node, 3:6] >= low[segment])).all(axis=1)
        segment, node = segment[overlap], node[overlap]
        ends = leaf[node] >= 0
        pairs.append((segment[ends], leaf[node[ends]]))
        segment, left = segment[~ends], node[~ends] + 1
        segment, node = np.concatenate([segment, segment]), np.concatenate([left, over[left]])
    segments, triangles = zip(*pairs, strict=True)
    return np.concatenate(segments), np.concatenate(triangles)
