"""Points near to points, by a k-d tree: on the host, when a body is made.

The tree only proposes; distances are computed here, pairs are sorted, so that the answer is the same on every machine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.waiting import steps
from softlab.model.geometry.arithmetic.ordered import norm

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

MAX_PAIRS = 2**26  # kept together: 2 GiB
FIRST_BLOCK = 1 << 10  # darts thrown together at first
BLOCK = 1 << 16  # points looked at together
SLACK = 1 + 2.0**-20  # of the radius that the tree is asked for: more than its rounding can differ from ours


class TooMany(InputError):
    """More pairs than can be stored."""


def pairs_within(queries: np.ndarray, points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (query (n,) int64, point (n,) int64, distance (n,) float64 [m]): every pair at most `radius` [m] apart, by
    query, then by point. `queries` (k, 3) and `points` (m, 3) [m]. Raises TooMany of them, before they fill the memory."""
    if len(queries) == 0 or len(points) == 0:
        empty = np.zeros(0, np.int64)
        return empty, empty, np.zeros(0)
    asked, tree = _tree(queries), _tree(points)
    if asked.count_neighbors(tree, radius) > MAX_PAIRS:
        raise TooMany(f"more than {MAX_PAIRS} pairs of particles lie within {radius:g} m; use a smaller radius")
    pairs = asked.sparse_distance_matrix(tree, radius * SLACK, output_type="ndarray")
    query, point = pairs["i"].astype(np.int64), pairs["j"].astype(np.int64)
    distance = norm(queries[query] - points[point])
    near = distance <= radius
    query, point, distance = query[near], point[near], distance[near]
    order = np.lexsort((point, query))
    return query[order], point[order], distance[order]


def _tree(points: np.ndarray) -> cKDTree:
    from scipy.spatial import cKDTree  # a tenth of a second, for those who make bodies

    return cKDTree(points)


def close_pairs(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (first (n,), second (n,) int64, distance (n,) [m]): of `points` (m, 3), first < second, ascending."""
    first, second, distance = pairs_within(points, points, radius)
    ahead = first < second
    return first[ahead], second[ahead], distance[ahead]


def nearest(queries: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (point (k,) int64, distance (k,) float64 [m]) of the nearest of `points` (m, 3), at least one, to each of
    `queries` (k, 3), the lowest of equally near ones."""
    if len(queries) == 0:
        return np.zeros(0, np.int64), np.zeros(0)
    tree = _tree(points)
    distances, place = tree.query(queries, k=[1, 2])  # without a second point: infinitely far
    index = place[:, 0].astype(np.int64)
    for query in np.flatnonzero(distances[:, 1] <= distances[:, 0] * SLACK):  # two or more that may be equally near
        near = np.sort(np.array(tree.query_ball_point(queries[query], distances[query, 0] * SLACK), dtype=np.int64))
        index[query] = near[np.argmin(norm(queries[query] - points[near]))]
    return index, norm(queries - points[index])


def spread(candidates: np.ndarray, taken: np.ndarray, distance: float, urgency: np.ndarray | None = None) -> np.ndarray:
    """Return the indices (n,) int64, ascending, of a maximal subset of `candidates` (k, 3) in which none is nearer than
    `distance` [m] to another or to `taken` (m, 3).

    Darts are thrown in a fixed random order, those of greater `urgency` (k,) first. They are taken in blocks, each
    twice as large as the last one: candidates near a dart of an earlier block are excluded before pairs are counted, so
    that candidates much denser than `distance`, as on a fine mesh, cost little.
    """
    left = np.flatnonzero(_apart(candidates, taken, distance))
    late = np.zeros(len(left)) if urgency is None else -urgency[left]
    left = left[np.lexsort((_scrambled(len(left)), late))]
    chosen, size = [np.zeros(0, np.int64)], FIRST_BLOCK
    while len(left):
        block, left = left[:size], left[size:]
        chosen.append(block[_first_ones(candidates[block], distance)])
        left = left[_apart(candidates[left], candidates[chosen[-1]], distance)]
        size *= 2
    return np.sort(np.concatenate(chosen))


def _apart(points: np.ndarray, taken: np.ndarray, distance: float) -> np.ndarray:
    """Return (n,) bool: True for `points` (n, 3) at least `distance` [m] from every point of `taken` (m, 3)."""
    free = np.ones(len(points), dtype=bool)
    begins = range(0, len(points), BLOCK)
    for begin in steps(begins, len(begins), "particles"):
        query, _, apart = pairs_within(points[begin : begin + BLOCK], taken, distance)
        free[begin + query[apart < distance]] = False
    return free


def _first_ones(points: np.ndarray, distance: float) -> np.ndarray:
    """Return (n,) bool: True for the `points` (n, 3) that are chosen in order, each at least `distance` [m] from the
    earlier ones. In rounds, each point that is the first among its neighbours is chosen and excludes them (M. Luby, "A
    simple parallel algorithm for the maximal independent set problem", SIAM J. Comput. 15 (1986)).
    """
    first, second, apart = close_pairs(points, distance)
    first, second = first[apart < distance], second[apart < distance]
    chosen = np.zeros(len(points), dtype=bool)
    open_ = np.ones(len(points), dtype=bool)
    while open_.any():
        won = open_.copy()
        won[second] = False  # second comes after first
        chosen |= won
        open_ &= ~won
        open_[second[won[first]]] = False
        stays = open_[first] & open_[second]
        first, second = first[stays], second[stays]
    return chosen


def _scrambled(count: int) -> np.ndarray:
    """Return (count,) uint64, all different: the finaliser of G. L. Steele et al., "Fast splittable pseudorandom number
    generators", OOPSLA 2014. Of our own, as NumPy may change its generators' streams."""
    z = (np.arange(count, dtype=np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
