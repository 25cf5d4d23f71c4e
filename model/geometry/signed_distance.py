"""Signed distances from the points of a grid to a closed mesh, in float64: what a distance field is sampled with.

The nearest triangle is found through the tree of boxes (model/geometry/triangle_tree.py) by the threads of the CPU backend,
which is named here and imported when it is needed, as those of families are (model/core/families.py).
Signs are those of winding numbers along the grid's columns (model/geometry/voxels.py).
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import import_module
from pathlib import Path
from time import perf_counter

import numpy as np

from softlab.model.base.digest import ROOT, source_digest
from softlab.model.base.disk_cache import cache_folder, read_arrays, write_arrays
from softlab.model.base.waiting import steps
from softlab.model.geometry.triangle_tree import order_of, tree_numbers
from softlab.model.geometry.voxels import runs_inside

KERNEL = "softlab.cpu_backend.contact.distances"
BATCH = 1 << 14  # points between two reports of progress; Ctrl-C takes effect there
VERSION = 1  # of the files
WORTH_KEEPING = 1.0  # s: what takes longer is kept on disk


def sampled(
    position: np.ndarray, triangles: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float
) -> tuple[np.ndarray, bool]:
    """Return `signed_distances`, from the user's cache if an earlier computation took long. The bits are the same."""
    digest = hashlib.sha256(f"{VERSION} {_sources()} {position.shape} {counts.tolist()} {spacing!r} ".encode())
    for array in (position, np.asarray(triangles, dtype=np.int64), low):
        digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.hexdigest()[:32]
    file = cache_folder("fields") / f"field-{key}.npz"
    cached = read_arrays(file) or {}
    distance = cached.get("distance")
    if distance is not None and distance.shape == tuple(counts) and str(cached.get("key")) == key:
        return distance, bool(cached.get("overlaps", False))
    begin = perf_counter()
    distance, overlaps = signed_distances(position, triangles, low, counts, spacing)
    if perf_counter() - begin > WORTH_KEEPING:
        write_arrays(file, {"key": np.array(key), "distance": distance, "overlaps": np.array(overlaps)})
    return distance, overlaps


@cache
def _sources() -> str:
    return source_digest(Path(__file__).parent, ROOT / Path(*KERNEL.split(".")[1:]).with_suffix(".py"))


def signed_distances(
    position: np.ndarray, triangles: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float
) -> tuple[np.ndarray, bool]:
    """Return (distances `counts` float64 [m], negative inside; whether the mesh overlaps itself) at the points low +
    (i, j, k) `spacing` [m], `counts` (3,) of them, of a mesh that is closed, outer sides outwards."""
    distance = np.sqrt(squared_distances(position[triangles], low, counts, spacing))
    runs = runs_inside(position, triangles, spacing, (low, counts))
    for index, _ in runs.points():
        i, j, k = index.T
        distance[i, j, k] *= -1
    return distance, runs.most > 1 or runs.least < 0


def squared_distances(corners: np.ndarray, low: np.ndarray, counts: np.ndarray, spacing: float) -> np.ndarray:
    """Return the squared distances [m^2] of points as in `signed_distances` to the nearest of the triangles `corners`
    (n, 3, 3), `counts` float64."""
    nearest = import_module(KERNEL).squared_distances
    numbers = tree_numbers(corners[order_of(corners)], np.float64)
    squared = np.empty((int(counts[0] * counts[1]), int(counts[2])))
    rows = max(1, BATCH // squared.shape[1])
    begins = range(0, len(squared), rows)
    for begin in steps(begins, len(begins), "distance field"):
        batch = slice(begin, min(begin + rows, len(squared)))
        squared[batch] = nearest(numbers, low, counts, spacing, batch)
    return squared.reshape(tuple(counts))
