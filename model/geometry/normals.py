"""Vertex normals of a cloth or a mesh, for drawing."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.measures import unit
from softlab.model.geometry.sheets import cell_corners


def vertex_normals(position: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Return (particles, 3) float64, each 1 long: the sum of the normals, as long as twice the area, of the triangles
    that a mass is a corner of, made 1 long; 0 where that sum is 0. `position` (particles, 3) in builder order.

    A cell is split from its first mass (row, column) to the one opposite, as model/tables/cloth.py says. Weighted by
    area: M. Botsch et al., "Polygon Mesh Processing" (2010), section 3.3.
    """
    p = np.asarray(position, dtype=np.float64).reshape(rows, columns, 3)
    a, b, c, d = cell_corners(p)
    lower, upper = np.cross(c - a, d - a), np.cross(d - a, b - a)
    normal = np.zeros_like(p)
    normal[:-1, :-1] += lower + upper
    normal[:-1, 1:] += upper
    normal[1:, :-1] += lower
    normal[1:, 1:] += lower + upper
    return unit(normal).reshape(-1, 3)


def mesh_normals(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return (vertices, 3) float64: the same of any `triangles` (n, 3) between vertices at `position` (vertices, 3)."""
    p = np.asarray(position, dtype=np.float64)
    a, b, c = (p[corner] for corner in triangles.T)
    each = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    corner = triangles.ravel()
    normal = np.stack([np.bincount(corner, each[:, axis], len(p)) for axis in range(3)], axis=1)
    return unit(normal)
