"""Points near to points, by cells of space: on the host, when a body is made.

Cells as large as the radius, points sorted by cell, so that what lies within the radius stands in nine runs of three cells
(M. Teschner et al., "Optimized Spatial Hashing for Collision Detection of Deformable Objects", VMV 2003, with a sort for the
hash: nothing collides, and the order is the same on every machine).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.core.errors import InputError

BATCH = 1 << 21  # pairs looked at together: some 100 MB
MOST_PAIRS = 2**26  # kept together: 2 GiB
MOST_CELLS = 2.0**20  # along an axis: three of them make a number of 63 bits
SLACK = 1 + 2.0**-20  # of a cell over the radius: more than rounding can take from a coordinate


class TooMany(InputError):
    """More pairs than can be kept."""


def pairs_within(queries: np.ndarray, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(query (n,) int64, point (n,) int64, distance (n,) float64 [m]): every pair at most `radius` [m] apart, by query, then
    by point. `queries` (k, 3) and `points` (m, 3) [m]. Raises TooMany of them, before they fill the memory."""
    found, count = [], 0
    for batch in _batches(queries, points, radius):
        found.append(batch)
        count += len(batch[0])
        if count > MOST_PAIRS:
            raise TooMany(f"more than {MOST_PAIRS} pairs of particles lie within {radius:g} m; use a smaller radius")
    query, point, distance = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.lexsort((point, query))
    return query[order], point[order], distance[order]


def close_pairs(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(first (n,), second (n,) int64, distance (n,) [m]): of `points` (m, 3), first < second, ascending."""
    first, second, distance = pairs_within(points, points, radius)
    ahead = first < second
    return first[ahead], second[ahead], distance[ahead]


def nearest(queries: np.ndarray, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """(point (k,) int64, distance (k,) float64 [m]) of the nearest of `points` (m, 3), at least one, to each of `queries`
    (k, 3), the lowest of equally near ones. `radius` [m]: a guess at how far that is, which costs time only."""
    index, least = np.full(len(queries), -1), np.full(len(queries), np.inf)
    left = np.arange(len(queries))
    while len(left):
        query, point, distance = pairs_within(queries[left], points, radius)
        order = np.lexsort((point, distance, query))
        found, first = np.unique(query[order], return_index=True)
        index[left[found]], least[left[found]] = point[order][first], distance[order][first]
        left = np.delete(left, found)
        radius *= 2
    return index, least


def _batches(
    queries: np.ndarray, points: np.ndarray, radius: float
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    empty = np.zeros(0, np.int64)
    yield empty, empty, np.zeros(0)
    if len(queries) == 0 or len(points) == 0:
        return
    low = np.minimum(points.min(axis=0), queries.min(axis=0))
    size = np.maximum(points.max(axis=0), queries.max(axis=0)) - low
    side = max(radius * SLACK, float(size.max()) / MOST_CELLS, np.finfo(float).tiny)
    cells = (size / side).astype(np.int64) + 3  # one more at either end: neighbours of neighbours never wrap round
    strides = np.array([cells[1] * cells[2], cells[2], 1])
    key = (((points - low) / side).astype(np.int64) + 1) @ strides
    order = np.argsort(key, kind="stable")
    key = key[order]
    place = (((queries - low) / side).astype(np.int64) + 1) @ strides
    for step in np.array([[x, y, 0] for x in (-1, 0, 1) for y in (-1, 0, 1)]) @ strides:
        first = np.searchsorted(key, place + step - 1, "left")
        count = np.searchsorted(key, place + step + 1, "right") - first
        ends = np.cumsum(count)
        begin = 0
        while begin < len(queries):
            before = int(ends[begin - 1]) if begin else 0
            end = max(begin + 1, int(np.searchsorted(ends, before + BATCH, "right")))
            some = slice(begin, end)
            query = np.repeat(np.arange(begin, end), count[some])
            entry = np.arange(len(query)) - np.repeat(ends[some] - count[some] - before, count[some])
            point = order[entry + np.repeat(first[some], count[some])]
            distance = np.linalg.norm(queries[query] - points[point], axis=1)
            near = distance <= radius
            yield query[near], point[near], distance[near]
            begin = end


def spread(candidates: np.ndarray, taken: np.ndarray, distance: float, urgency: np.ndarray | None = None) -> np.ndarray:
    """(n,) int64, ascending: which of `candidates` (k, 3) to take so that none lies nearer than `distance` [m] to another or
    to `taken` (m, 3), and no other could be added.

    Darts are thrown in a fixed random order, those of greater `urgency` (k,) first; in rounds, each that comes first among
    what is near to it is taken and shuts out the rest (M. Luby, "A simple parallel algorithm for the maximal independent
    set problem", SIAM J. Comput. 15 (1986)): the same as one after the other.
    """
    free = np.ones(len(candidates), dtype=bool)
    query, _, apart = pairs_within(candidates, taken, distance)
    free[query[apart < distance]] = False
    kept = np.flatnonzero(free)
    first, second, apart = close_pairs(candidates[kept], distance)
    first, second = first[apart < distance], second[apart < distance]
    order = np.lexsort((_scrambled(len(kept)), -(urgency[kept] if urgency is not None else np.zeros(len(kept)))))
    rank = np.empty(len(kept), dtype=np.int64)
    rank[order] = np.arange(len(kept))
    chosen = np.zeros(len(kept), dtype=bool)
    open_ = np.ones(len(kept), dtype=bool)
    while open_.any():
        ahead = np.full(len(kept), len(kept))
        np.minimum.at(ahead, first, rank[second])
        np.minimum.at(ahead, second, rank[first])
        won = open_ & (rank < ahead)
        chosen |= won
        open_ &= ~won
        open_[first[won[second]]] = False
        open_[second[won[first]]] = False
        left = open_[first] & open_[second]
        first, second = first[left], second[left]
    return kept[chosen]


def _scrambled(count: int) -> np.ndarray:
    """(count,) uint64, all different: the finaliser of G. L. Steele et al., "Fast splittable pseudorandom number generators",
    OOPSLA 2014. Of our own, as NumPy may change its generators' streams."""
    z = (np.arange(count, dtype=np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
