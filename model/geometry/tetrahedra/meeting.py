"""The occupied voxels, and where two triangles of a surface meet in them or on the sides between them."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.edges import MeshEdges

DENSE = 1 << 24  # cells of a lattice up to which a table tells the voxel of each

Pairs = tuple[
    np.ndarray, np.ndarray
]  # triangles and the numbers of voxels (pairs,) int64 that they pass through, ascending


class Cells:
    """Voxels: `index` (voxels, 3) int64, rows ascending, of a lattice of `counts` (3,)."""

    def __init__(self, index: np.ndarray, counts: np.ndarray) -> None:
        self.counts = counts
        self.key = np.unique(self._key(index))
        self.index = np.stack(np.unravel_index(self.key, tuple(int(count) for count in counts)), axis=1)
        self._table = None
        if int(np.prod(counts)) <= DENSE:
            self._table = np.full(int(np.prod(counts)), -1, dtype=np.int32)
            self._table[self.key] = np.arange(len(self.key))

    def __len__(self) -> int:
        return len(self.key)

    def _key(self, index: np.ndarray) -> np.ndarray:
        key: np.ndarray = (index[:, 0] * self.counts[1] + index[:, 1]) * self.counts[2] + index[:, 2]
        return key

    def number(self, index: np.ndarray) -> np.ndarray:
        """Return (n,) int64: the voxel at each `index` (n, 3), -1 where there is none."""
        inside = ((index >= 0) & (index < self.counts)).all(axis=1)
        key = np.where(inside, self._key(index), 0)
        if self._table is not None:
            number = self._table[key].astype(np.int64)
        else:
            place = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
            number = np.where(self.key[place] == key, place, -1)
        return np.where(inside, number, -1)

    def beside(self, axis: int) -> np.ndarray:
        """Return (voxels,) int64: the next voxel along `axis`, -1 for none."""
        return self.number(self.index + np.eye(3, dtype=np.int64)[axis])


def across_edges(place: np.ndarray, edges: MeshEdges, cells: Cells, pairs: Pairs) -> np.ndarray:
    """Return (n, 2): those of `pairs` in one voxel whose triangles share an edge that passes through it. `place`
    (vertices, 3): in voxels."""
    triangle, voxel = pairs
    side = edges.sides[triangle].astype(np.int64)
    key = (side * len(cells) + voxel[:, None]).ravel()
    order = np.argsort(key, kind="stable")
    twice = np.flatnonzero(key[order][1:] == key[order][:-1])
    one, two = order[twice], order[twice + 1]
    passing = _passes(place, edges.edges[side.ravel()[one]], cells.index[voxel[one // 3]], (0, 1, 2))
    return np.stack([one[passing] // 3, two[passing] // 3], axis=1)


def over_edges(
    place: np.ndarray, triangles: np.ndarray, edges: MeshEdges, cells: Cells, pairs: Pairs, axis: int
) -> np.ndarray:
    """Return (n, 2): the connections across a side between consecutive voxels along `axis`, by an edge on that side:
    the pairs of the edge's two triangles; or, where one of these lies on the side and has the voxel behind on its inner
    side, the other's pair and pairs + that voxel. The lower voxel's first."""
    triangle, voxel = pairs
    count = len(triangle)
    side = edges.sides[triangle].astype(np.int64).ravel()
    level = place[edges.edges, axis]
    flat = (level[:, 0] == level[:, 1]) & (level[:, 0] == np.round(level[:, 0]))
    some = np.flatnonzero(flat[side])
    pair, edge = some // 3, side[some]
    low = cells.index[voxel[pair]]
    up = level[edge, 0].astype(np.int64) - low[:, axis]  # 0: on the voxel's lower side, 1: on its upper
    other_voxel = cells.number(low + (2 * up - 1)[:, None] * np.eye(3, dtype=np.int64)[axis])
    passing = (up >= 0) & (up <= 1) & (other_voxel >= 0)
    passing &= _passes(place, edges.edges[edge], low, ((axis + 1) % 3, (axis + 2) % 3))
    pair, edge, up, other_voxel = pair[passing], edge[passing], up[passing], other_voxel[passing]
    beside = edges.triangles[edge]
    other = np.where(beside[:, 0] == triangle[pair], beside[:, 1], beside[:, 0]).astype(np.int64)
    neighbour, there = positions(triangle * len(cells) + voxel, other * len(cells) + other_voxel)
    a, b, c = (place[corner] for corner in triangles[other].T)
    outwards = np.cross(b - a, c - a)[:, axis]
    on_side = (a[:, axis] == b[:, axis]) & (b[:, axis] == c[:, axis]) & (outwards * (2 * up - 1) < 0)
    behind = np.where(there, neighbour, count + other_voxel)
    ends = np.stack([np.where(up == 1, pair, behind), np.where(up == 1, behind, pair)], axis=1)
    return ends[there | on_side]


def _passes(place: np.ndarray, ends: np.ndarray, low: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    """Return (n,) bool: True if the edge between `ends` (n, 2) passes through the box from `low` (n, 3) to one voxel further
    along `axes`, its rim excluded: W. B. Liang, B. A. Barsky, ACM Transactions on Graphics 3 (1984).
    """
    a, b = place[ends[:, 0]], place[ends[:, 1]]
    enters, leaves = np.zeros(len(a)), np.ones(len(a))
    passing = np.ones(len(a), dtype=bool)
    for k in axes:
        span, before, behind = b[:, k] - a[:, k], low[:, k] - a[:, k], low[:, k] + 1 - a[:, k]
        still = span == 0
        passing &= ~still | ((before < 0) & (behind > 0))
        span = np.where(still, 1.0, span)
        first, second = before / span, behind / span
        enters = np.maximum(enters, np.where(still, 0.0, np.minimum(first, second)))
        leaves = np.minimum(leaves, np.where(still, 1.0, np.maximum(first, second)))
    return passing & (enters < leaves)


def positions(keys: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (index of each of `wanted` in `keys`, which ascend; bool: True if it is there)."""
    if not len(keys):
        return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=bool)
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return place, keys[place] == wanted
