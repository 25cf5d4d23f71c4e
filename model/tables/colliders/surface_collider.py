"""The common base of colliders made from a mesh: the mesh's source, its position and rotation, its motion."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from softlab.model.base.table import ZERO, Positive, Vector
from softlab.model.base.types import Real
from softlab.model.geometry.arithmetic.ordered import applied, norm
from softlab.model.geometry.measures import rotation_matrix
from softlab.model.tables.cloth import Collider
from softlab.model.tables.mesh_source import MeshSource


class SurfaceCollider(MeshSource, Collider):
    """A mesh at `origin`, rotated there by `angle` about `axis`, that moves at `velocity`, rotates about its origin at
    `spin`, and carries masses along."""

    such_as: ClassVar[str] = "blob"

    spin: Vector = ZERO  # rad/s
    thickness: Positive = 0.01  # m

    def _read(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        """Return (position (vertices, 3) [m], triangles (n, 3), a sentence for each repair), unrotated. Raises
        InputError."""
        raise NotImplementedError

    def numbers(self, real: Real) -> np.ndarray:
        """Return the numbers that kernels read, in the arithmetic `real`. Raises SceneError, InputError."""
        raise NotImplementedError

    @property
    def number_count(self) -> int:
        """Number of these numbers. Raises SceneError, InputError."""
        raise NotImplementedError

    def too_many(self) -> tuple[str, object, str]:
        """Return (field, its value, remedy) for a precision that cannot count its numbers."""
        raise NotImplementedError

    @cached_property
    def _mesh(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        position, triangles, notes = self._read()
        return applied(self.turn(), position), triangles, notes

    @property
    def position(self) -> np.ndarray:
        """Vertices relative to the mesh's origin at time 0, (vertices, 3) float64 [m]. Raises InputError for a file
        without a mesh."""
        return self._mesh[0]

    @property
    def triangles(self) -> np.ndarray:
        """Indices of vertices, (n, 3), counter-clockwise from the front. Raises InputError."""
        return self._mesh[1]

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on omissions and repairs of the file. Raises InputError."""
        return self._mesh[2]

    def turn(self) -> np.ndarray:
        """Return the initial rotation, (3, 3) float64, by Rodrigues' formula."""
        return turn_matrix(np.radians(self.angle) * np.asarray(self.axis) / (float(norm(self.axis)) or 1.0))

    def turn_at(self, time: float) -> np.ndarray:
        """Return the rotation from the start to `time` [s], (3, 3) float64."""
        return turn_matrix(np.asarray(self.spin) * time)

    def lines(self) -> list[str]:
        """Return a user's lines on the mesh: its size and omissions. Raises SceneError, InputError."""
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.position, axis=0))
        return [f"{len(self.triangles)} triangles, {size} m", *self.notes]


def turn_matrix(turn: np.ndarray) -> np.ndarray:
    """Return the rotation about `turn` (3,) by its length [rad], (3, 3) float64."""
    angle = float(norm(turn))
    return rotation_matrix(turn / (angle or 1.0), angle)
