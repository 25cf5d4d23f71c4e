"""A mesh that follows the clusters of a body: four clusters and weights for every vertex.

Linear blend skinning: N. Magnenat-Thalmann et al., "Joint-Dependent Local Deformations for Hand Animation and Object
Grasping", Graphics Interface 1988, with the clusters for joints. The devices' skins are held against `skinned` here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.measures import unit
from softlab.model.geometry.normals import mesh_normals

INFLUENCES = 4  # clusters of a vertex
BATCH = 1 << 22  # distances at once


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh at rest and the clusters that move it.

    `position` and `normal` (vertices, 3) float64 [m, 1 long], `triangles` (n, 3) int32; `clusters` (vertices, 4) int32 and
    `weights` (vertices, 4) float64, which add up to 1, largest first; where a body has fewer than four clusters the last
    entries repeat the nearest, with weight 0. `rest_centre` (clusters, 3) float64 [m].
    """

    position: np.ndarray
    normal: np.ndarray
    triangles: np.ndarray
    clusters: np.ndarray
    weights: np.ndarray
    rest_centre: np.ndarray

    def skinned(self, centre: np.ndarray, deformation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (position, normal) (vertices, 3) float64: with the clusters at `centre` (clusters, 3) [m], turned, and
        stretched and sheared if they are, by `deformation` (clusters, 3, 3), which takes vectors at rest, as columns,
        to now.

        A vertex is the weighted mean of where each of its clusters takes it; a normal, of where they take surfaces: by the
        inverse transpose times the volume, the matrix of cofactors, made 1 long (0 where they cancel).
        """
        turn = deformation[self.clusters]
        away = self.position[:, None] - self.rest_centre[self.clusters]
        position = np.einsum("vk,vki->vi", self.weights, centre[self.clusters] + np.einsum("vkij,vkj->vki", turn, away))
        normal = np.einsum("vk,vkij,vj->vi", self.weights, cofactors(deformation)[self.clusters], self.normal)
        return position, unit(normal)


def cofactors(matrices: np.ndarray) -> np.ndarray:
    """Return (n, 3, 3): of each its inverse transpose times its determinant, a rotation's being itself."""
    x, y, z = np.moveaxis(matrices, 1, 0)
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def make_skin(position: np.ndarray, triangles: np.ndarray, rest_centre: np.ndarray) -> Skin:
    """Return the skin of the mesh of `position` (vertices, 3) [m] and `triangles` (n, 3), over clusters at
    `rest_centre` (n, 3)."""
    nearest, distance = _nearest(position, rest_centre, INFLUENCES + 1)
    clusters, weights = influences(nearest, distance)
    return Skin(
        np.asarray(position, dtype=np.float64),
        mesh_normals(position, triangles),
        np.ascontiguousarray(triangles, dtype=np.int32),
        clusters,
        weights,
        np.asarray(rest_centre, dtype=np.float64),
    )


def influences(nearest: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (clusters (vertices, 4) int32, weights (vertices, 4) float64) of the `nearest` clusters (vertices, n), n
    at most 5, at `distance` (vertices, n) [m], ascending.

    A weight falls to 0 at the distance of the fifth, as (1 - d^2/d5^2)^2, so that it fades where another cluster takes its
    place; with four clusters or fewer, none does, and it falls to 0 at twice the farthest's distance.
    """
    count = nearest.shape[1]
    limit = distance[:, -1:] * (1.0 if count > INFLUENCES else 2.0)
    taken = min(count, INFLUENCES)
    part = np.divide(distance, limit, out=np.zeros_like(distance), where=limit > 0)[:, :taken]
    weights = np.zeros((len(nearest), INFLUENCES))
    weights[:, :taken] = (1 - part * part) ** 2
    level = weights.sum(axis=1) == 0  # five at one distance
    weights[level, :taken] = 1
    weights /= weights.sum(axis=1, keepdims=True)
    clusters = np.repeat(nearest[:, :1], INFLUENCES, axis=1)
    clusters[:, :taken] = nearest[:, :taken]
    return clusters.astype(np.int32), weights


def _nearest(points: np.ndarray, centres: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (index (points, n), distance (points, n)): of the min(count, centres) nearest, ascending, the lower index
    first."""
    count = min(count, len(centres))
    index, away = np.empty((len(points), count), dtype=np.int64), np.empty((len(points), count))
    step = max(1, BATCH // len(centres))
    for begin in range(0, len(points), step):
        some = slice(begin, begin + step)
        # one axis after the other: a third of the memory, and of the time
        square = sum(np.square(points[some, None, axis] - centres[None, :, axis]) for axis in range(3))
        candidates = np.argpartition(square, count - 1, axis=1)[:, :count] if count < len(centres) else None
        if candidates is None:
            candidates = np.broadcast_to(np.arange(len(centres)), square.shape)
        squares = np.take_along_axis(square, candidates, axis=1)
        # a partition chooses among equally far ones by the processor's own order: there by their numbers
        tied = np.flatnonzero((square <= squares.max(axis=1, keepdims=True)).sum(axis=1) > count)
        if len(tied):
            candidates[tied] = np.argsort(square[tied], axis=1, kind="stable")[:, :count]
            squares[tied] = np.take_along_axis(square[tied], candidates[tied], axis=1)
        order = np.lexsort((candidates, squares), axis=1)
        index[some] = np.take_along_axis(candidates, order, axis=1)
        away[some] = np.sqrt(np.take_along_axis(squares, order, axis=1))
    return index, away
