"""Signed distances from the points of a grid to a closed mesh, in float64: what a distance field is sampled with.

The nearest triangle is found through the tree of boxes (model/geometry/triangle_tree.py), level by level and for many points
at once. The triangles with the nearest middles bound the search.
Signs are those of winding numbers along the grid's columns (model/geometry/voxels.py).
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from time import perf_counter

import numpy as np

from model.core.digest import source_digest
from model.core.disk_cache import cache_folder, read_arrays, write_arrays
from model.core.waiting import steps
from model.formulas.triangle_tree import NODE
from model.geometry.triangle_tree import order_of, tree_numbers
from model.geometry.voxels import runs_inside

GUESSES = 4  # triangles by their middles
BATCH = 1 << 13  # points looked at together: their pairs with boxes stay in the cache
VERSION = 1  # of the files
WORTH_KEEPING = 1.0  # s: what takes longer is kept on disk


def sampled(
    position: np.ndarray, triangles: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float
) -> tuple[np.ndarray, bool]:
    """`signed_distances`, from the user's cache where they took long to make before: the same bits either way."""
    digest = hashlib.sha256(f"{VERSION} {_sources()} {position.shape} {counts.tolist()} {spacing!r} ".encode())
    for array in (position, np.asarray(triangles, dtype=np.int64), low):
        digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.hexdigest()[:32]
    file = cache_folder("fields") / f"field-{key}.npz"
    held = read_arrays(file) or {}
    distance = held.get("distance")
    if distance is not None and distance.shape == tuple(counts) and str(held.get("key")) == key:
        return distance, bool(held.get("overlaps", False))
    begin = perf_counter()
    distance, overlaps = signed_distances(position, triangles, low, counts, spacing)
    if perf_counter() - begin > WORTH_KEEPING:
        write_arrays(file, key=np.array(key), distance=distance, overlaps=np.array(overlaps))
    return distance, overlaps


@cache
def _sources() -> str:
    return source_digest(Path(__file__).parent)


def signed_distances(
    position: np.ndarray, triangles: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float
) -> tuple[np.ndarray, bool]:
    """(distances `counts` float64 [m], negative inside; whether the mesh overlaps itself) at the points low + (i, j, k)
    `spacing` [m], `counts` (3,) of them, of a mesh that is closed, outer sides outwards."""
    distance = np.sqrt(squared_distances(position[triangles], low, counts, spacing))
    runs = runs_inside(position, triangles, spacing, (low, counts))
    for index, _ in runs.points():
        i, j, k = index.T
        distance[i, j, k] *= -1
    return distance, runs.most > 1 or runs.least < 0


def squared_distances(corners: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float) -> np.ndarray:
    """`counts` float64 [m^2]: from points as in `signed_distances` to the nearest of triangles `corners` (n, 3, 3)."""
    from scipy.spatial import cKDTree  # a tenth of a second, for those who have fields

    corners = corners[order_of(corners)]
    nodes = tree_numbers(corners, np.float64)[: NODE * (2 * len(corners) - 1)].reshape(-1, NODE)
    middles = cKDTree(corners.mean(axis=1))
    squared = np.empty(tuple(counts))
    flat = squared.reshape(-1)
    begins = range(0, flat.size, BATCH)
    for begin in steps(begins, len(begins), "distance field"):
        index = np.stack(np.unravel_index(np.arange(begin, min(begin + BATCH, flat.size)), squared.shape), axis=1)
        points = low + index * spacing
        guesses = middles.query(points, min(GUESSES, len(corners)))[1].reshape(len(points), -1)
        flat[begin : begin + BATCH] = _nearest(points, guesses, nodes, corners)
    return squared


def _nearest(points: np.ndarray, guesses: np.ndarray, nodes: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return squared distances (n,) of `points` (n, 3). `guesses` (n, k): triangles that bound the search."""
    best = np.full(len(points), np.inf)
    for guess in guesses.T:
        np.minimum(best, _squared(points, corners[guess]), out=best)
    point, node = np.arange(len(points)), np.zeros(len(points), np.int64)
    skip, leaf_of = nodes[:, 6].astype(np.int64), nodes[:, 7].astype(np.int64)
    axes = [[np.ascontiguousarray(row) for row in (nodes[:, k], nodes[:, k + 3], points[:, k])] for k in range(3)]
    while len(point):
        squared = np.zeros(len(point))
        for low, high, x in axes:
            here = x[point]
            away = np.maximum(np.maximum(low[node] - here, here - high[node]), 0)
            squared += away * away
        near = squared < best[point]
        point, node = point[near], node[near]
        triangle = leaf_of[node]
        leaf = triangle >= 0
        at, triangle = point[leaf], triangle[leaf]
        squared = _squared(points[at], corners[triangle])
        np.minimum.at(best, at, squared)
        point, first = point[~leaf], node[~leaf] + 1
        point, node = np.concatenate([point, point]), np.concatenate([first, skip[first]])
    return best


def _squared(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) [m^2]: from `points` (n, 3) to the triangles `corners` (n, 3, 3), as `way_from` of the formulas of the tree: along
    the normal where the point lies above the triangle, else from the nearest edge."""
    a, b, c = np.ascontiguousarray(np.moveaxis(corners, 0, -1))  # (3, n) each: an axis is a row
    p = np.ascontiguousarray(points.T)
    starts, edges = (p - a, p - b, p - c), (b - a, c - b, a - c)
    normal = _cross(edges[0], edges[1])
    size, least, best = _dot(normal, normal), np.inf, np.inf
    for start, edge in zip(starts, edges, strict=True):
        length = _dot(edge, edge)
        part = np.clip(_dot(start, edge) / np.where(length > 0, length, 1.0), 0, 1)
        way = start - part * edge
        best = np.minimum(best, _dot(way, way))
        least = np.minimum(least, _dot(normal, _cross(edge, start)))
    height = _dot(normal, starts[0])
    above = height * height / np.where(size > 0, size, 1.0)
    found: np.ndarray = np.where((least >= 0) & (size > 0), above, best)
    return found


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    found: np.ndarray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
