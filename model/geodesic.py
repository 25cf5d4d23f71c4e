"""Distances at rest from anchors, for long-range attachments: each mass stays within that distance of its anchors.

T.-Y. Kim, N. Chentanez, M. Mueller-Fischer, "Long Range Attachments - A Method to Simulate Inextensible Clothing in Computer
Games" (SCA 2012), section 3: the K nearest anchors and the geodesic distance to each. On a flat sheet without holes or notches
that is the straight line; on a mesh the shortest way along edges, which is never too short, so that it holds nothing back that
the cloth itself allows.
"""

from __future__ import annotations

import numpy as np

from model.errors import SceneError
from model.mesh_edges import Lists, MeshEdges

CHUNK = 2**22  # distances at once: some 100 MB
KEY_BITS = 31  # of a distance over the largest: what is nearer together than that counts as equal
MOST_COUNT = 64

Attachments = tuple[np.ndarray, np.ndarray]


def sheet_attachments(rest_position: np.ndarray, pinned: np.ndarray, count: int) -> Attachments:
    """(anchor (particles, count) int32, distance (particles, count) float64 [m]) of a flat sheet: for each particle its
    `count` nearest of the `pinned` ones, nearest first, the lower index first of equally near ones.

    -1 and inf where there are fewer. `rest_position` (particles, dimensions) [m]. Anchors in a row along an axis, as all the
    words of `pinned` give them, are found among their neighbours in the row; only scattered ones are all looked at.
    Raises SceneError (count).
    """
    pinned = np.unique(np.asarray(pinned, dtype=np.int64))
    position = np.asarray(rest_position, dtype=np.float64)
    anchor, distance = _empty(len(position), count)
    taken = min(count, len(pinned))
    if taken == 0 or len(position) == 0:
        return anchor, distance
    held = position[pinned]
    axes = np.flatnonzero(np.ptp(held, axis=0) > 0)
    lines, scattered = _lines(held, axes, count)
    largest = float(np.linalg.norm(np.ptp(position, axis=0))) or 1.0
    width = len(scattered) + sum(min(2 * count, len(line)) for _, line in lines)
    step = max(1, CHUNK // width)
    for start in range(0, len(position), step):
        here = position[start : start + step]
        near = [np.broadcast_to(scattered, (len(here), len(scattered)))]
        near += [_window(here[:, axis], held[line, axis], line, count) for axis, line in lines]
        candidate = np.concatenate(near, axis=1)
        length = _length(here, held, candidate)
        # one number to sort by: the rounded distance, then the anchor's index
        key = np.rint(length / largest * 2.0**KEY_BITS).astype(np.int64) << KEY_BITS | candidate
        key = _distinct(key, taken)
        chosen = key & (2**KEY_BITS - 1)
        anchor[start : start + step, :taken] = pinned[chosen]
        distance[start : start + step, :taken] = _length(here, held, chosen)
    return anchor, distance


def _empty(particles: int, count: int) -> Attachments:
    if not 1 <= count <= MOST_COUNT:
        raise SceneError("count", count, f"must be 1 to {MOST_COUNT} anchors for each particle")
    return np.full((particles, count), -1, dtype=np.int32), np.full((particles, count), np.inf)


def _length(here: np.ndarray, held: np.ndarray, candidate: np.ndarray) -> np.ndarray:
    """(particles, candidates) [m]: from `here` (particles, dimensions) to `held[candidate]`."""
    total = np.zeros(candidate.shape)
    for axis in range(here.shape[1]):
        total += (held[candidate, axis] - here[:, None, axis]) ** 2
    return np.sqrt(total)


def _lines(held: np.ndarray, axes: np.ndarray, count: int) -> tuple[list[tuple[int, np.ndarray]], np.ndarray]:
    """Anchors that differ along one axis only: (axis, their numbers sorted along it); and the numbers of all others.

    An anchor at a crossing belongs to one line. A line pays where a particle's neighbours in it are fewer than all.
    """
    lines: list[tuple[int, np.ndarray]] = []
    left = np.arange(len(held))
    for axis in axes:
        _, line = np.unique(np.delete(held[left], axis, axis=1), axis=0, return_inverse=True)
        line = line.ravel()
        long = np.bincount(line) > 4 * count
        for number in np.flatnonzero(long):
            members = left[line == number]
            lines.append((int(axis), members[np.argsort(held[members, axis], kind="stable")]))
        left = left[~long[line]]
    return lines, left


def _window(along: np.ndarray, stops: np.ndarray, line: np.ndarray, count: int) -> np.ndarray:
    """(particles, 2 count): the `count` anchors of `line`, sorted by `stops`, to either side of `along` (particles,)."""
    first = np.clip(np.searchsorted(stops, along) - count, 0, len(line) - 2 * count)
    return line[first[:, None] + np.arange(2 * count)]


def _distinct(key: np.ndarray, taken: int) -> np.ndarray:
    """The `taken` least of each row, ascending."""
    if key.shape[1] > 4 * taken:
        key = np.partition(key, taken - 1, axis=1)[:, :taken]
    return np.sort(key, axis=1)[:, :taken]
