"""Matrices of the clusters of a scene's bodies, from a state, for the shaders that deform skins. No OpenGL."""

from __future__ import annotations

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.core.simulation import Simulation
from softlab.model.scene.scene import Scene


class ClusterFrames:
    """Matrices of the clusters of all bodies of `scene`: they map points of the meshes at rest to the current state."""

    def __init__(self, scene: Scene):
        body_set, parts = scene.body_set, scene.bodies
        self._clusters, copies = body_set.clusters, body_set.in_cluster_order
        turns = [np.broadcast_to(parts[copy.name].turn(), (copy.baked.clusters.count, 3, 3)) for copy in copies]
        self._turn = np.concatenate(turns)  # a copy's own, at the start, when its clusters are not turned yet
        self._rest = np.concatenate([copy.baked.skin.rest_centre for copy in copies])
        self.count = body_set.clusters.count

    def matrices(self, centre: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Return the matrices (clusters, 3, 4) float32, for points of the mesh extended by 1.

        `centre` (clusters, 3) [m] is the current centre; `rotation` (clusters, 3, 3) is the rotation or deformation
        since the start, applied after the initial rotation.
        """
        turn = rotation @ self._turn
        transforms = np.empty((self.count, 3, 4), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):
            transforms[:, :, :3] = turn
            transforms[:, :, 3] = centre - np.einsum("nij,nj->ni", turn, self._rest)
        return transforms

    def of_state(self, position: np.ndarray) -> np.ndarray:
        """Return the matrices from positions (particles, 3) [m] alone: rotations by singular values; for plastic
        clusters the nearest linear map. Positions that are not finite give matrices that are not finite."""
        position = np.asarray(position, dtype=np.float64)
        if np.isfinite(position).all():
            return self.matrices(self._clusters.centres(position), self._deformations(position))
        return np.full((self.count, 3, 4), np.nan, np.float32)

    def _deformations(self, position: np.ndarray) -> np.ndarray:
        clusters = self._clusters
        if "plastic" not in clusters.parts:
            return clusters.deformations(position)
        return np.where(clusters.flat[:, None, None], clusters.rotations(position), clusters.strained(position))

    def of_simulation(self, simulation: Simulation, position: np.ndarray | None = None) -> np.ndarray:
        """Return the matrices from the solver's rotations, or from `position` (None: read) if the solver has none.
        Clusters that also deform use the whole map from rest offsets to goals."""
        try:
            turn, centre = (np.asarray(values, np.float64) for values in simulation.read_clusters())
            if self._clusters.parts & {"linear", "plastic"}:
                return self.matrices(centre, np.asarray(simulation.read("deformation"), np.float64))
        except (SceneError, NotImplementedError):
            return self.of_state(simulation.read("position") if position is None else position)
        return self.matrices(centre, of_quaternions(turn))


def of_quaternions(quaternion: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), w first. K. Shoemake, "Animating Rotation with
    Quaternion Curves", SIGGRAPH 1985."""
    w, x, y, z = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
