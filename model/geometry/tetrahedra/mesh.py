"""Tetrahedra with common vertices: volumes, quality, masses and surface, and checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite

import numpy as np

from softlab.model.base.errors import InputError, SceneError
from softlab.model.geometry.arithmetic.ordered import dot
from softlab.model.geometry.edges import components
from softlab.model.geometry.mesh_files import LARGEST

ROUNDING = 16 * float(np.finfo(np.float64).eps)  # of a coordinate: what its own rounding can make of a flat tetrahedron
# the corners of the faces of (a, b, c, d), seen from outside in mathematical order; face k lies opposite to corner k
FACES = np.array([(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)])
SIDES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])  # the corners of its six edges


@dataclass(frozen=True, eq=False)
class TetrahedralMesh:
    """Tetrahedra of positive volume.

    `position` (vertices, 3) float64 [m]; `tetrahedra` (n, 4) int32: a, b, c, d with det(b - a, c - a, d - a) > 0. Raises
    InputError: no tetrahedron, coordinates that are not finite or over LARGEST, corners that are no vertices, a volume that
    is not over 0 (or that is 0 up to rounding).
    """

    position: np.ndarray
    tetrahedra: np.ndarray

    def __post_init__(self) -> None:
        position = np.asarray(self.position, dtype=np.float64).reshape(-1, 3)
        corners = np.asarray(self.tetrahedra).reshape(-1, 4)
        _check(position, corners)
        object.__setattr__(self, "position", np.ascontiguousarray(position))
        object.__setattr__(self, "tetrahedra", np.ascontiguousarray(corners, dtype=np.int32))
        check_volumes(self.position, self.tetrahedra, self.volumes)

    @cached_property
    def volumes(self) -> np.ndarray:
        """Return the volumes, (n,) float64 [m^3]."""
        return signed_volumes(self.position, self.tetrahedra)

    @property  # not cached: cube roots differ between processors, and what a simulation holds must not
    def quality(self) -> np.ndarray:
        """Return (n,) float64 in (0, 1]: the mean ratio 12 (3 V)^(2/3) / (sum of the squared edges), 1 of a regular
        tetrahedron, near 0 of a flat one (A. Liu, B. Joe, "Relationship between tetrahedron shape measures", BIT 34
        (1994), eta)."""
        squares = np.square(
            self.position[self.tetrahedra[:, SIDES[:, 1]]] - self.position[self.tetrahedra[:, SIDES[:, 0]]]
        )
        return np.minimum(12 * np.cbrt(3 * self.volumes) ** 2 / squares.sum(axis=(1, 2)), 1.0)

    @cached_property
    def surface(self) -> np.ndarray:
        """Return (m, 3) int32: the faces that belong to one tetrahedron only, outer side outwards."""
        faces = self.tetrahedra[:, FACES].reshape(-1, 3)
        number, count = self._numbered(faces)
        return np.ascontiguousarray(faces[count[number] == 1])

    @cached_property
    def face_counts(self) -> np.ndarray:
        """Return (faces,) int64: to how many tetrahedra each face belongs; 1 or 2 in a mesh that conforms."""
        return self._numbered(self.tetrahedra[:, FACES].reshape(-1, 3))[1]

    def pieces(self) -> int:
        """Return the number of parts connected by vertices."""
        first = self.tetrahedra[:, 0]
        ends = np.concatenate([np.stack([first, self.tetrahedra[:, k]], axis=1) for k in (1, 2, 3)])
        return len(np.unique(components(len(self.position), ends)[first]))

    def masses(self, density: float) -> np.ndarray:
        """Return (vertices,) float64 [kg]: a quarter of each tetrahedron of `density` [kg/m^3] at each of its corners
        (lumped). Raises SceneError."""
        check_density(density)
        quarter = np.repeat(self.volumes * (density / 4), 4)
        return np.bincount(self.tetrahedra.ravel(), quarter, minlength=len(self.position))

    def _numbered(self, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (the number of the face that each of `faces` (m, 3) is, how many are it)."""
        low, middle, high = np.sort(faces, axis=1).T.astype(np.int64)
        key = low * len(self.position) + middle
        order = np.lexsort((high, key))
        key, high = key[order], high[order]
        new = np.concatenate([[True], (key[1:] != key[:-1]) | (high[1:] != high[:-1])])
        number = np.empty(len(order), dtype=np.int64)
        number[order] = np.cumsum(new) - 1
        return number, np.bincount(number)


def signed_volumes(position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """Return (n,) float64 [m^3]: of `tetrahedra` (n, 4) between `position` (vertices, 3) [m]; negative of those inside
    out."""
    a, b, c, d = (position[corner] for corner in np.asarray(tetrahedra).T)
    return dot(np.cross(b - a, c - a), d - a) / 6


def rest_inverse(position: np.ndarray, tetrahedra: np.ndarray) -> np.ndarray:
    """Return (n, 3, 3) float64 [1/m]: the inverse of each tetrahedron's edge matrix, whose columns are b - a, c - a, d
    - a. The edge matrix of a deformed state times it is the deformation gradient (E. Sifakis, J. Barbic, "FEM
    Simulation of 3D Deformable Solids", SIGGRAPH courses (2012), section 4.1)."""
    a, b, c, d = (position[corner] for corner in np.asarray(tetrahedra).T)
    one, two, three = b - a, c - a, d - a
    rows = np.stack([np.cross(two, three), np.cross(three, one), np.cross(one, two)], axis=1)
    determinant: np.ndarray = dot(one, rows[:, 0])[:, None, None]
    inverse: np.ndarray = rows / determinant
    return inverse


def check_density(density: float) -> None:
    """Raise SceneError for an invalid density [kg/m^3]."""
    if not (isfinite(density) and density > 0):
        raise SceneError("density", density, "must be a finite number greater than 0 [kg/m^3]")


def _check(position: np.ndarray, corners: np.ndarray) -> None:
    if len(corners) == 0:
        raise InputError("there is no tetrahedron; export the mesh with its volume elements, not its surface alone")
    wrong = ~np.isfinite(position).all(axis=1)
    if wrong.any():
        vertex = int(np.argmax(wrong))
        raise InputError(
            f"{int(wrong.sum())} of {len(position)} vertices have no finite coordinates, first vertex {vertex} (counted from "
            f"0), {position[vertex].tolist()}; export the mesh again"
        )
    size = float(np.abs(position).max(initial=0.0))
    if size > LARGEST:
        raise InputError(
            f"a coordinate of {size:.10g} m; at most {LARGEST:g}: move the origin nearer to 0, or give a scale that turns "
            "the file's unit to m"
        )
    least, most = int(corners.min()), int(corners.max())
    if least < 0 or most >= len(position):
        tetrahedron = int(np.argmax((corners < 0).any(axis=1) | (corners >= len(position)).any(axis=1)))
        raise InputError(
            f"tetrahedron {tetrahedron} (counted from 0) names vertex {least if least < 0 else most}, and there are "
            f"{len(position)}; the mesh is damaged or cut short: export it again"
        )


def check_volumes(position: np.ndarray, tetrahedra: np.ndarray, volumes: np.ndarray) -> None:
    """Raise InputError for `volumes` (n,) [m^3] of `tetrahedra` (n, 4) that are not over 0, or not by more than rounding of
    `position` (vertices, 3) [m] explains."""
    corners = position[tetrahedra]
    low, high = corners.min(axis=1), corners.max(axis=1)
    longest = (high - low).max(axis=1)
    largest = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
    wrong = ~(volumes > ROUNDING * largest * longest**2)
    if not wrong.any():
        return
    first, inverted = int(np.argmax(wrong)), int((volumes < 0).sum())
    where = ", ".join(f"{x:.4g}" for x in corners[first].mean(axis=0))
    kind = "inside out" if volumes[first] < 0 else "flat"
    if inverted == len(volumes):
        remedy = "all are inside out: swap two corners of each"
    elif inverted:
        remedy = "swap two corners of those that are inside out, or mesh the body again"
    else:
        remedy = "mesh the body again, coarser or nearer to the origin, and without slivers"
    raise InputError(
        f"{int(wrong.sum())} of {len(volumes)} tetrahedra have no volume or are inside out, first tetrahedron {first} "
        f"(counted from 0) at ({where}), {kind}, volume {volumes[first]:.3g} m^3; {remedy}"
    )
