"""What colliders made from a mesh have in common: where the mesh comes from, where it stands, and how it moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from model.core.errors import SceneError
from model.geometry.arithmetic.ordered import applied, norm
from model.geometry.measures import rotation_matrix
from model.scene.cloth import Collider
from model.scene.mesh_source import MeshSource
from model.scene.parts import ZERO, Positive, Vector


class SurfaceCollider(MeshSource, Collider):
    """A mesh that stands at `origin`, turned there by `angle` about `axis`, moves at `velocity` and turns about its origin at
    `spin`; masses in its way are swept along."""

    such_as: ClassVar[str] = "blob"

    spin: Vector = ZERO  # rad/s
    thickness: Positive = 0.01  # m

    def _read(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        """(position (vertices, 3) [m], triangles (n, 3), a sentence for what was made good), unturned. Raises InputError."""
        raise NotImplementedError

    def numbers(self, real: Any) -> np.ndarray:
        """What kernels read of it, in the arithmetic `real`. Raises SceneError, InputError."""
        raise NotImplementedError

    @property
    def number_count(self) -> int:
        """How many numbers there are. Raises SceneError, InputError."""
        raise NotImplementedError

    def too_many(self) -> tuple[str, object, str]:
        """(field, its value, what to do) where an arithmetic cannot count its numbers."""
        raise NotImplementedError

    @cached_property
    def _mesh(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        position, triangles, told = self._read()
        return applied(self.turn(), position), triangles, told

    @property
    def position(self) -> np.ndarray:
        """(vertices, 3) float64 [m], from the mesh's origin, at time 0. Raises InputError for a file that is no mesh."""
        return self._mesh[0]

    @property
    def triangles(self) -> np.ndarray:
        """(n, 3), indices of vertices; counter-clockwise from the front. Raises InputError."""
        return self._mesh[1]

    @property
    def told(self) -> tuple[str, ...]:
        """A sentence for what was left out of the file, or made good. Raises InputError."""
        return self._mesh[2]

    def turn(self) -> np.ndarray:
        """(3, 3) float64: the start's rotation, by Rodrigues' formula."""
        return turn_matrix(np.radians(self.angle) * np.asarray(self.axis) / (float(norm(self.axis)) or 1.0))

    def turn_at(self, time: float) -> np.ndarray:
        """(3, 3) float64: from the start to `time` [s]."""
        return turn_matrix(np.asarray(self.spin) * time)

    def lines(self) -> list[str]:
        """What to tell a user of it: its size, and what was left out. Raises SceneError, InputError."""
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.position, axis=0))
        return [f"{len(self.triangles)} triangles, {size} m", *self.told]


@contextmanager
def naming(part: str) -> Iterator[None]:
    """Errors of a part's fields under its name, which it does not know."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{part}.{error.field}", error.value, error.allowed) from None


def turn_matrix(turn: np.ndarray) -> np.ndarray:
    """(3, 3) float64: the rotation about `turn` (3,) by its length [rad]."""
    angle = float(norm(turn))
    return rotation_matrix(turn / (angle or 1.0), angle)
