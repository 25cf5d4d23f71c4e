"""Distances at rest from anchors, for long-range attachments: each mass stays within that distance of its anchors.

T.-Y. Kim, N. Chentanez, M. Mueller-Fischer, "Long Range Attachments - A Method to Simulate Inextensible Clothing in Computer
Games" (SCA 2012), section 3: the K nearest anchors and the geodesic distance to each. On a flat sheet without holes or
notches that is the straight line; on a mesh the shortest way along edges, which is never too short, so that it holds
nothing back that the cloth itself allows.
"""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.geometry.arithmetic.ordered import mean, norm
from softlab.model.geometry.edges import MeshEdges
from softlab.model.geometry.lists import Lists, ranges
from softlab.model.geometry.measures import edge_lengths

BLOCK = 2**18  # particles at once: some 50 MB
KEY_BITS = 31  # of a distance over the largest: what is nearer together than that counts as equal
MAX_COUNT = 64

Attachments = tuple[np.ndarray, np.ndarray]


def sheet_attachments(rest_position: np.ndarray, pinned: np.ndarray, count: int) -> Attachments:
    """Return (anchor (particles, count) int32, distance (particles, count) float64 [m]) of a flat sheet: for each
    particle its `count` nearest of the `pinned` ones, nearest first, the lower index first of equally near ones.

    -1 and inf where there are fewer. `rest_position` (particles, dimensions) [m]. A k-d tree proposes; distances are computed
    here, rounded to KEY_BITS and sorted, so that the answer is the same on every machine. Raises SceneError (count).
    """
    from scipy.spatial import cKDTree

    pinned = np.unique(np.asarray(pinned, dtype=np.int64))
    position = np.asarray(rest_position, dtype=np.float64)
    anchor, distance = _empty(len(position), count)
    taken = min(count, len(pinned))
    if taken == 0 or len(position) == 0:
        return anchor, distance
    pinned_position = position[pinned]
    tree = cKDTree(pinned_position)
    largest = float(norm(np.ptp(position, axis=0))) or 1.0
    for begin in range(0, len(position), BLOCK):
        left, asked = np.arange(begin, min(begin + BLOCK, len(position))), taken
        while len(left):
            asked = min(2 * asked, len(pinned))
            here = position[left]
            near = tree.query(here, asked)[1].reshape(len(left), asked)
            rounded = np.rint(_length(here, pinned_position, near) / largest * 2.0**KEY_BITS).astype(np.int64)
            key = np.sort(rounded << KEY_BITS | near, axis=1)[:, :taken]  # one number to sort by
            # who was not asked is no nearer than the last who was, but for rounding
            sure = (rounded[:, -1] > (key[:, -1] >> KEY_BITS) + 1) | (asked == len(pinned))
            chosen = key[sure] & (2**KEY_BITS - 1)
            anchor[left[sure], :taken] = pinned[chosen]
            distance[left[sure], :taken] = _length(here[sure], pinned_position, chosen)
            left = left[~sure]
    return anchor, distance


def mesh_attachments(position: np.ndarray, edges: MeshEdges, anchors: np.ndarray, count: int) -> Attachments:
    """Return (anchor (vertices, count) int32, distance (vertices, count) float64 [m]) of a mesh: for each vertex its
    `count` nearest of the vertices `anchors` along the edges of `position` (vertices, 3) [m], nearest first, the lower
    index first of equally far ones; -1 and inf where fewer can be reached.

    E. W. Dijkstra's labels (1959), `count` to a vertex, a front as deep as a mean edge at once and mended where it ran
    ahead (U. Meyer, P. Sanders, "Delta-stepping" (2003)): the same numbers as one after the other. Of our own, as those of
    scipy go over the whole mesh for each anchor, of which a row may be pinned. Raises SceneError (count).
    """
    anchors = np.unique(np.asarray(anchors, dtype=np.int64))
    anchor, distance = _empty(len(position), count)
    neighbours = edges.neighbours
    owner = np.repeat(np.arange(len(position)), neighbours.lengths)
    length = edge_lengths(position, np.stack([neighbours.indices, owner], axis=1))
    depth = mean(length) if len(length) else 0.0
    anchor[anchors, 0], distance[anchors, 0] = anchors, 0.0
    vertex, source, far = anchors, anchors, np.zeros(len(anchors))
    while len(vertex):
        now = far <= far.min() + depth
        later = vertex[~now], source[~now], far[~now]
        vertex, source, far = vertex[now], source[now], far[now]
        current = ((anchor[vertex] == source[:, None]) & (distance[vertex] == far[:, None])).any(axis=1)
        front = _spread(vertex[current], source[current], far[current], neighbours, length)
        new = _insert_labels(*front, anchor, distance)
        vertex, source, far = (np.concatenate(pair) for pair in zip(later, new, strict=True))
    return anchor, distance


Labels = tuple[np.ndarray, np.ndarray, np.ndarray]  # vertex, the anchor it has a way to, how far that is


def _spread(vertex: np.ndarray, source: np.ndarray, far: np.ndarray, neighbours: Lists, length: np.ndarray) -> Labels:
    """Return the labels after every labelled vertex passed its label on to all its neighbours."""
    start = neighbours.offsets[vertex]
    label, entry = ranges(start, neighbours.offsets[vertex + 1] - start)
    return neighbours.indices[entry].astype(np.int64), source[label], far[label] + length[entry]


def _insert_labels(
    vertex: np.ndarray, source: np.ndarray, far: np.ndarray, anchor: np.ndarray, distance: np.ndarray
) -> Labels:
    """Insert the labels that are among the nearest of their vertex into `anchor` and `distance`; return those inserted."""
    count = anchor.shape[1]
    better = far < distance[vertex, -1]
    better |= (far == distance[vertex, -1]) & (source < anchor[vertex, -1])
    better &= ~((anchor[vertex] == source[:, None]) & (distance[vertex] <= far[:, None])).any(axis=1)
    vertex, source, far = vertex[better], source[better], far[better]
    touched = np.unique(vertex)
    old = anchor[touched].ravel() >= 0
    fresh = np.concatenate([np.ones(len(vertex), dtype=bool), np.zeros(int(old.sum()), dtype=bool)])
    vertex = np.concatenate([vertex, np.repeat(touched, count)[old]])
    source = np.concatenate([source, anchor[touched].ravel()[old]])
    far = np.concatenate([far, distance[touched].ravel()[old]])
    order = np.lexsort((far, source, vertex))  # of an anchor's several paths the shortest
    order = order[_first(vertex[order], source[order])]
    order = order[np.lexsort((source[order], far[order], vertex[order]))]
    first = np.flatnonzero(_first(vertex[order]))
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    order, rank = order[rank < count], rank[rank < count]
    anchor[touched], distance[touched] = -1, np.inf
    anchor[vertex[order], rank], distance[vertex[order], rank] = source[order], far[order]
    order = order[fresh[order]]
    return vertex[order], source[order], far[order]


def _first(*columns: np.ndarray) -> np.ndarray:
    """Return (n,) bool: rows that differ from the one before."""
    new = np.ones(len(columns[0]), dtype=bool)
    new[1:] = np.any([column[1:] != column[:-1] for column in columns], axis=0)
    return new


def _empty(particles: int, count: int) -> Attachments:
    if not 1 <= count <= MAX_COUNT:
        raise SceneError("count", count, f"must be 1 to {MAX_COUNT} anchors for each particle")
    return np.full((particles, count), -1, dtype=np.int32), np.full((particles, count), np.inf)


def _length(here: np.ndarray, targets: np.ndarray, candidate: np.ndarray) -> np.ndarray:
    """Return (particles, candidates) [m]: the distances from `here` (particles, dimensions) to `targets[candidate]`."""
    total = np.zeros(candidate.shape)
    for axis in range(here.shape[1]):
        total += (targets[candidate, axis] - here[:, None, axis]) ** 2
    return np.sqrt(total)
