"""Points that are carried by tetrahedra: each by the corners of one, with weights that add up to 1 (barycentric)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.arithmetic.ordered import applied, combined, dot, norm
from softlab.model.geometry.tetrahedra.mesh import FACES, TetrahedralMesh, rest_inverse

OUTSIDE = 1e-9  # of a weight below 0: less is rounding
NEAREST = 24  # tetrahedra, by their middles, that a point may lie in


@dataclass(frozen=True, eq=False)
class Embedding:
    """Carriers of points: for each the tetrahedron, `tetrahedron` (points,) int32, and the `weights` (points, 4)
    float64 of its corners, which add up to 1; a weight is below 0 where the point lies outside."""

    tetrahedron: np.ndarray
    weights: np.ndarray

    def points(self, position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
        """Return (points, 3) float64 [m]: where the points are while the vertices are at `position` (vertices, 3) [m]."""
        points: np.ndarray = combined(self.weights, position[tetrahedra[self.tetrahedron]])
        return points

    def beyond(self, position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
        """Return (points,) float64 [m]: the distance of each point beyond the farthest face plane of its tetrahedron, 0
        inside.

        A weight is the height above the opposite face as a fraction of the height of the corner.
        """
        corners = position[tetrahedra[self.tetrahedron]]
        a, b, c = (np.take(corners, FACES[:, k], axis=1) for k in range(3))  # (points, 4 faces, 3)
        area = norm(np.cross(b - a, c - a))  # twice
        edges = corners[:, 1:] - corners[:, :1]
        volume = np.abs(dot(edges[:, 0], np.cross(edges[:, 1], edges[:, 2])))  # six times
        away = np.where(self.weights < -OUTSIDE, -self.weights, 0.0) * volume[:, None]
        distance: np.ndarray = np.divide(away, area, out=np.zeros_like(away), where=area > 0).max(axis=1)
        return distance


def weights_of(points: np.ndarray, position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """Return (points, 4) float64: of each of `points` (n, 3) [m] in the tetrahedron of `tetrahedra` (n, 4) in the same
    row."""
    start = position[tetrahedra[:, 0]]
    rest = applied(rest_inverse(position, tetrahedra), points - start)
    return np.column_stack([1 - rest.sum(axis=1), rest])


def carriers(mesh: TetrahedralMesh, points: np.ndarray) -> Embedding:
    """Return the embedding of `points` (n, 3) [m]: each point is carried by the tetrahedron that contains it, or else
    by the one of the nearest few that it is least outside of."""
    from scipy.spatial import cKDTree

    count = min(NEAREST, len(mesh.tetrahedra))
    near = cKDTree(mesh.position[mesh.tetrahedra].mean(axis=1)).query(points, k=[*range(1, count + 1)])[1]
    weights = weights_of(np.repeat(points, count, axis=0), mesh.position, mesh.tetrahedra[near.ravel()])
    weights = weights.reshape(-1, count, 4)
    best = weights.min(axis=2).argmax(axis=1)[:, None]
    best_weights = np.take_along_axis(weights, best[..., None], axis=1)[:, 0]
    return Embedding(np.take_along_axis(near, best, axis=1)[:, 0].astype(np.int32), best_weights)
