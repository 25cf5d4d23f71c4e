"""Where ways lead through a mesh: all ways at once, in NumPy, for what is drawn. Masses are asked one by one, by
model/formulas/triangle_tree.py."""

from __future__ import annotations

import numpy as np

from softlab.model.formulas.triangle_tree import CORNERS, NODE


def first_crossings(tree: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(triangle (n,) int64 that each way from `begin` (n, 3) to `end` (n, 3) [m] crosses first, -1 where it crosses none; its
    unit normal (n, 3), to the side that the way comes from). `tree`: `tree_numbers` in float64. A way through an edge crosses
    both triangles; a place on a triangle lies before its front."""
    nodes, corners = _parts(tree)
    way, triangle = _candidates(nodes, begin, end)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    p, q = begin[way], end[way]
    normal = np.cross(b - a, c - a)
    before, after = (((point - a) * normal).sum(axis=1) for point in (p, q))
    across = (before >= 0) != (after >= 0)
    a, b, c = a - p, b - p, c - p
    edges = np.stack([(np.cross(one, other) * (q - p)).sum(axis=1) for one, other in ((a, b), (b, c), (c, a))])
    across &= (edges.min(axis=0) >= 0) | (edges.max(axis=0) <= 0)
    way, triangle, normal, before, after = (array[across] for array in (way, triangle, normal, before, after))
    order = np.lexsort((triangle, before / (before - after), way))
    met, first = np.unique(way[order], return_index=True)
    kept = order[first]
    found, side = np.full(len(begin), -1), np.zeros_like(begin)
    found[met] = triangle[kept]
    length = np.where(before >= 0, 1, -1) * np.sqrt((normal**2).sum(axis=1))
    side[met] = normal[kept] / length[kept, None]
    return found, side


def corners_of(tree: np.ndarray) -> np.ndarray:
    """(triangles, 3, 3) [m] of a tree, in its order."""
    return _parts(tree)[1]


def _parts(tree: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(nodes (n, NODE), corners (triangles, 3, 3))."""
    count = int(tree[6])  # the root's end: how many nodes there are
    return tree[: count * NODE].reshape(count, NODE), tree[count * NODE :].reshape(-1, CORNERS // 3, 3)


def _candidates(nodes: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(ways, triangles) (pairs,) int64 whose boxes meet, down the tree level by level."""
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    over, leaf = nodes[:, 6].astype(np.int64), nodes[:, 7].astype(np.int64)
    way, node = np.arange(len(begin)), np.zeros(len(begin), np.int64)
    found = [(way[:0], node[:0])]
    while len(way):
        meet = ((nodes[node, 0:3] <= high[way]) & (nodes[node, 3:6] >= low[way])).all(axis=1)
        way, node = way[meet], node[meet]
        ends = leaf[node] >= 0
        found.append((way[ends], leaf[node[ends]]))
        way, left = way[~ends], node[~ends] + 1
        way, node = np.concatenate([way, way]), np.concatenate([left, over[left]])
    ways, triangles = zip(*found, strict=True)
    return np.concatenate(ways), np.concatenate(triangles)
