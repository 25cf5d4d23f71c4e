"""What colliders made from a mesh have in common: where the mesh comes from, where it stands, and how it moves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from pydantic import model_validator

from model.core.errors import SceneError
from model.geometry.shapes import Shape
from model.scene.bodies import file_digest
from model.scene.cloth import ZERO, Collider, Number, Vector
from model.scene.parts import Positive

FILE_CONTRADICTIONS = {"shape": ("file", "digest", "scale"), "file": ("shape", "digest")}


class SurfaceCollider(Collider):
    """A mesh that stands at `origin`, turned there by `angle` about `axis`, moves at `velocity` and turns about its origin at
    `spin`; masses in its way are swept along."""

    such_as: ClassVar[str] = "blob"  # a shape to name where none is given

    shape: Shape | None = None  # of the lab's own
    file: str | None = None  # .obj, .stl or .ply
    digest: str | None = None  # of the file's bytes, written where the scene is: it must still be that file
    scale: Positive = 1.0  # m per unit of the file
    origin: Vector = ZERO  # m
    angle: Number = 0.0  # degrees
    axis: Vector = (0.0, 1.0, 0.0)
    spin: Vector = ZERO  # rad/s
    thickness: Positive = 0.01  # m

    @model_validator(mode="after")
    def _one_source(self) -> SurfaceCollider:
        if (self.shape is None) == (self.file is None):
            raise ValueError(f'file: give either a file or a shape, such as shape = {{ name = "{self.such_as}" }}')
        if self.shape is not None and (self.digest is not None or self.scale != 1):
            raise ValueError("scale: belongs to a file; a shape has a scale of its own")
        if self.angle != 0 and not any(self.axis):
            raise ValueError("axis: must point somewhere, such as [0.0, 1.0, 0.0]")
        if self.file is not None:
            digest = file_digest(self.file)
            if self.digest not in (None, digest):
                raise ValueError(f"digest: {self.file} is another file by now ({digest}); leave it out")
            self.__dict__["digest"] = digest  # the part is frozen for everyone else
        return self

    def _idle_fields(self) -> set[str]:
        """Only what can be given: a scene that is written can be read."""
        return super()._idle_fields() | ({"file", "digest", "scale"} if self.shape is not None else {"shape"})

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
        return position @ self.turn().T, triangles, told

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
        return turn_matrix(np.radians(self.angle) * np.asarray(self.axis) / (float(np.linalg.norm(self.axis)) or 1.0))

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
    """(3, 3) float64: the rotation about `turn` (3,) by its length [rad], by Rodrigues' formula."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / (angle or 1.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix
