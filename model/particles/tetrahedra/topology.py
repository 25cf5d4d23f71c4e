"""Neighbours of vertices of tetrahedra."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot
from softlab.model.geometry.lists import Lists, grouped

PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))  # corners of the edges


def neighbours(tetrahedra: np.ndarray, count: int) -> Lists:
    """Return for each of `count` vertices those with which it shares one of `tetrahedra` (n, 4), ascending."""
    ends = np.concatenate([tetrahedra[:, pair] for pair in PAIRS]).astype(np.int64)
    both = np.unique(dot(np.concatenate([ends, ends[:, ::-1]]), np.array([count, 1])))
    return grouped(both // count, both % count, count)


def bodies_of_particles(first_particle: np.ndarray, count: int) -> np.ndarray:
    """Return the number of each particle's body, (count,) int64; `first_particle`: of each body."""
    body: np.ndarray = np.searchsorted(first_particle, np.arange(count), side="right") - 1
    return body
