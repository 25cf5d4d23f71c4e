"""What masses cannot pass that is a surface of triangles: the part of a scene, its triangles, and how they are stored."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from pydantic import model_validator

from model.body_parts import file_digest
from model.cloth_parts import ZERO, Collider, Number, Vector
from model.errors import InputError
from model.formulas.triangle_tree import CORNERS, NODE
from model.mesh import check_vertices, without_flat
from model.mesh_files import read_arrays
from model.parts import Positive
from model.shapes import Shape
from model.topology import mesh_path
from model.triangle_tree import order_of, tree_numbers

LEAST_AREA = 5e-18  # m^2: the square of a smaller one is nothing in float32
FILE_CONTRADICTIONS = {"shape": ("file", "digest", "scale"), "file": ("shape", "digest")}


class MeshCollider(Collider):
    """A surface of triangles, of one side as solid as of the other, open or closed: it has no inside.

    A mass whose way crosses a triangle is put back on the side it came from; one nearer than `thickness` is put at that
    distance. The mesh stands at `origin`, turned there by `angle` about `axis`, moves at `velocity` and turns about its
    origin at `spin`; masses in its way are swept along.
    """

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
    def _one_source(self) -> MeshCollider:
        if (self.shape is None) == (self.file is None):
            raise ValueError('file: give either a file or a shape, such as shape = { name = "terrain" }')
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

    @cached_property
    def _mesh(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        told: list[str] = []
        if self.shape is not None:
            made = self.shape.mesh()
            position, triangles = made.position, made.triangles
        else:
            path = mesh_path(self.file or "")
            read, triangles, _ = read_arrays(path)
            try:
                position = read * self.scale
                check_vertices(position)
                triangles = without_flat(position, triangles, told)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        triangles = _with_area(position, triangles, told)
        return position @ self.turn().T, triangles, tuple(told)

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
        """A sentence for what was left out of the file. Raises InputError."""
        return self._mesh[2]

    @cached_property
    def corners(self) -> np.ndarray:
        """(n, 3, 3) float64 [m]: triangles by their corners, in the order of the tree. Raises InputError."""
        corners = self.position[self.triangles]
        ordered: np.ndarray = corners[order_of(corners)]
        return ordered

    def tree(self, real: Any) -> np.ndarray:
        """The tree's numbers in the arithmetic `real`, see model/triangle_tree.py. Raises InputError."""
        return tree_numbers(self.corners, real)

    @property
    def tree_size(self) -> int:
        """How many numbers `tree` has."""
        return NODE * (2 * len(self.triangles) - 1) + CORNERS * len(self.triangles)

    def turn(self) -> np.ndarray:
        """(3, 3) float64: the start's rotation, by Rodrigues' formula."""
        return turn_matrix(np.radians(self.angle) * np.asarray(self.axis) / (float(np.linalg.norm(self.axis)) or 1.0))

    def turn_at(self, time: float) -> np.ndarray:
        """(3, 3) float64: from the start to `time` [s]."""
        return turn_matrix(np.asarray(self.spin) * time)

    def lines(self) -> list[str]:
        """What to tell a user of it: its size, and what was left out. Raises InputError."""
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.position, axis=0))
        return [f"{len(self.triangles)} triangles, {size} m", *self.told]


def turn_matrix(turn: np.ndarray) -> np.ndarray:
    """(3, 3) float64: the rotation about `turn` (3,) by its length [rad], by Rodrigues' formula."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / (angle or 1.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def _with_area(position: np.ndarray, triangles: np.ndarray, told: list[str]) -> np.ndarray:
    """Without triangles that are nothing in float32; how many is added to `told`. Raises InputError where none is left."""
    a, b, c = (position[corner] for corner in triangles.T)
    large = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 2 * LEAST_AREA
    if not large.any():
        raise InputError(
            "a mesh_collider whose triangles are all too small: give a scale that turns the file's unit to m"
        )
    if not large.all():
        told.append(f"{int((~large).sum())} triangles too small for float32 were left out")
    return triangles[large]
