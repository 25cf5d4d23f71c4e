"""The part `mesh_collider`: a surface of triangles that masses cannot pass, and its storage for kernels."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.types import Real
from softlab.model.formulas.triangle_tree import CORNERS, NODE
from softlab.model.geometry.measures import triangle_areas
from softlab.model.geometry.mending.welding import without_flat
from softlab.model.geometry.mesh_files import read_arrays
from softlab.model.geometry.topology import mesh_path
from softlab.model.geometry.triangle_tree import order_of, tree_numbers
from softlab.model.tables.colliders.surface_collider import SurfaceCollider

MIN_AREA = 5e-18  # m^2: the square of a smaller area is 0 in float32


class MeshCollider(SurfaceCollider):
    """A surface of triangles with two solid sides, open or closed: it has no inside.

    A mass whose path crosses a triangle is put back on the side it came from; one nearer than `thickness` is moved to
    that distance.
    """

    such_as: ClassVar[str] = "terrain"

    def _read(self) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
        omissions: list[str] = []
        if self.shape is not None:
            mesh = self.shape.mesh()
            position, triangles = mesh.position, mesh.triangles.astype(np.int64)
        else:
            path = mesh_path(self.file or "")
            position, triangles, notes = read_arrays(path, self.scale)
            omissions += notes
            try:
                triangles = without_flat(position, triangles, omissions)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
        triangles = _with_area(position, triangles, omissions)
        return position, triangles, tuple(omissions)

    @cached_property
    def corners(self) -> np.ndarray:
        """Triangles by their corners, (n, 3, 3) float64 [m], in the order of the tree. Raises InputError."""
        corners = self.position[self.triangles]
        ordered: np.ndarray = corners[order_of(corners)]
        return ordered

    @cached_property
    def tree(self) -> np.ndarray:
        """`numbers` in float64. Raises InputError."""
        return self.numbers(np.float64)

    def numbers(self, real: Real) -> np.ndarray:
        """Return the nodes of the tree, flat (model/geometry/triangle_tree.py)."""
        return tree_numbers(self.corners, real)

    @property
    def number_count(self) -> int:
        """Number of the tree's numbers."""
        return NODE * (2 * len(self.triangles) - 1) + CORNERS * len(self.triangles)

    def too_many(self) -> tuple[str, object, str]:
        """Return the error's fields, see SurfaceCollider."""
        field = "file" if self.file else "shape"
        return field, f"{len(self.triangles)} triangles", "a triangle takes 25 numbers: decimate it"


def _with_area(position: np.ndarray, triangles: np.ndarray, omissions: list[str]) -> np.ndarray:
    """Return the triangles without those that vanish in float32; append the number of the latter to `omissions`.

    Raises InputError where none is left.
    """
    large = triangle_areas(position, triangles) > MIN_AREA
    if not large.any():
        raise InputError(
            "a mesh_collider whose triangles are all too small: give a scale that turns the file's unit to m"
        )
    if not large.all():
        omissions.append(f"{int((~large).sum())} triangles too small for float32 were left out")
    return triangles[large]
