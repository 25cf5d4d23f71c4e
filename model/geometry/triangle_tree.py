"""A tree of boxes around the triangles of a mesh, as numbers that both backends walk; see model/formulas/triangle_tree.py.

Triangles are halved by the median of their middles along the longest side of the box of these, level by level and all parts
of a level at once. So the tree's form follows from the number of triangles alone: a part of m of them is a node and 2 m - 2
below it.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.base.waiting import work
from softlab.model.formulas.triangle_tree import CORNERS, NODE
from softlab.model.geometry.lists import offsets_of, ranges

GROWN = 16  # eps of the largest coordinate, by which boxes are larger: rounded distances to them are no larger than the true


def parts_of(count: int) -> list[np.ndarray]:
    """Return, level by level, (parts, 3) int64: first triangle, one past the last, node. A leaf is alone in its
    level."""
    levels = [np.array([[0, count, 0]])]
    while True:
        first, last, node = levels[-1][levels[-1][:, 1] - levels[-1][:, 0] > 1].T
        if not len(first):
            return levels
        middle = (first + last) // 2
        below = np.stack([first, middle, node + 1, middle, last, node + 2 * (middle - first)], axis=1)
        levels.append(below.reshape(-1, 3))


@work("sorting triangles")
def order_of(corners: np.ndarray) -> np.ndarray:
    """Return the order of the triangles `corners` (n, 3, 3) in the tree, (n,) int64."""
    middles, order = corners.mean(axis=1), np.arange(len(corners))
    for level in parts_of(len(corners)):
        first, last, _ = level[level[:, 1] - level[:, 0] > 1].T
        if not len(first):
            break
        part, taken = ranges(first, last - first)
        here, starts = middles[order[taken]], offsets_of(last - first)[:-1]
        sides = np.maximum.reduceat(here, starts) - np.minimum.reduceat(here, starts)
        along = here[np.arange(len(here)), sides.argmax(axis=1)[part]]
        order[taken] = order[taken][np.lexsort((along, part))]
    return order


def tree_numbers(corners: np.ndarray, real: Real) -> np.ndarray:
    """Return (NODE (2 n - 1) + CORNERS n,) in the arithmetic `real`: the tree of triangles (n, 3, 3), in their
    `order_of`."""
    count = len(corners)
    rounded: np.ndarray = corners.reshape(count, CORNERS).astype(real)
    low, high = rounded.reshape(-1, 3, 3).min(axis=1), rounded.reshape(-1, 3, 3).max(axis=1)
    margin = real(GROWN * np.finfo(real).eps * np.abs(rounded).max(initial=0))
    nodes: np.ndarray = np.empty((2 * count - 1, NODE), real)
    for level in parts_of(count):
        first, last, node = level.T
        ends = np.stack([first, last], axis=1).ravel()[: -1 if last[-1] == count else None]
        nodes[node, 0:3] = np.minimum.reduceat(low, ends)[::2] - margin
        nodes[node, 3:6] = np.maximum.reduceat(high, ends)[::2] + margin
        nodes[node, 6] = node + 2 * (last - first) - 1
        nodes[node, 7] = np.where(last - first == 1, first, -1)
    return np.concatenate([nodes.ravel(), rounded.ravel()])
