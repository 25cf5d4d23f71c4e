"""A tetrahedral body: its mesh, its embedded surface, and the report on it. It is built from voxels, from a surface, or
from given tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.arithmetic.ordered import dot, mean, total
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.mesh_files import check_vertices
from softlab.model.geometry.solid import as_mesh, solid
from softlab.model.geometry.tetrahedra.conforming import conforming_mesh
from softlab.model.geometry.tetrahedra.embedding import Embedding
from softlab.model.geometry.tetrahedra.fractions import MIN_STIFFNESS, mean_of_four
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh, check_density
from softlab.model.geometry.tetrahedra.report import Report, report_of
from softlab.model.geometry.tetrahedra.voxels import PerVoxel, edge_of, voxel_mesh

DENSITY = 1000.0  # kg/m^3: water's, as jelly's


@dataclass(frozen=True, eq=False)
class CookedBody:
    """A tetrahedral body and the surface that it carries.

    `voxel` (n, 3), `colour` (n,), `starts` (voxels + 1,) int32: as of VoxelMesh; empty of a body that is not of voxels.
    `hull_position` (points, 3) float64 [m] and `hull_triangles` (m, 3) int32: the closed surface; `embedding`: the
    embedding of its points. `fractions` (n, 4): the fraction of each tetrahedron within the surface, for each of its
    corners (fractions.py).
    """

    mesh: TetrahedralMesh
    voxel: np.ndarray
    colour: np.ndarray
    starts: np.ndarray
    hull_position: np.ndarray
    hull_triangles: np.ndarray
    embedding: Embedding
    report: Report
    fractions: np.ndarray

    @property
    def fraction(self) -> np.ndarray:
        """Fraction of its stiffness that each tetrahedron has, (n,) float64: the volume of its part inside the surface
        over its whole volume, at least MIN_STIFFNESS."""
        return np.maximum(mean_of_four(self.fractions), MIN_STIFFNESS)

    @property
    def per_voxel(self) -> int:
        """Tetrahedra per voxel: 5 (the first is twice as large as the others) or 6; 0 if the body was not built from
        voxels."""
        if not len(self.voxel):
            return 0
        first, second = self.mesh.volumes[:2]
        return 5 if first > 1.5 * second else 6

    def with_density(self, density: float) -> CookedBody:
        """Return the body with another density [kg/m^3]. Raises SceneError."""
        check_density(density)
        return replace(self, report=replace(self.report, density=density, mass=density * self.report.volume))


def body_of_voxels(
    mesh: TriangleMesh | tuple[np.ndarray, np.ndarray], edge: float | None, voxels: int | None, per_voxel: PerVoxel
) -> CookedBody:
    """Return the body of voxels within `mesh`. Raises SceneError and InputError."""
    cut = voxel_mesh(mesh, edge=edge, voxels=voxels, per_voxel=per_voxel)
    size = len(cut.starts) - 1, cut.edges, cut.doubled
    hull, fractions = cut.hull, cut.fractions
    surface = hull.position, hull.triangles
    report = report_of(cut.mesh, cut.embedding, hull.volume, DENSITY, hull.notes, size, fractions, surface)
    return CookedBody(cut.mesh, cut.voxel, cut.colour, cut.starts, *surface, cut.embedding, report, fractions)


def body_of_surface(
    mesh: TriangleMesh | tuple[np.ndarray, np.ndarray], edge: float | None, voxels: int | None
) -> CookedBody:
    """Return the body of tetrahedra that follow the surface."""
    position, triangles = mesh if isinstance(mesh, tuple) else (mesh.position, mesh.triangles)
    position, triangles = np.asarray(position, dtype=np.float64), np.asarray(triangles, dtype=np.int32)
    check_vertices(position)
    filling, embedding = conforming_mesh(position, triangles, edge_of(position, edge, voxels))
    notes: tuple[str, ...] = ()
    try:
        volume = solid(as_mesh((position, triangles), inside=True), 0.0).volume
    except InputError as error:
        volume, notes = total(filling.volumes), (f"its surface has no volume of its own: {error}",)
    none = np.zeros(0, np.int32)
    report = report_of(filling, embedding, volume, DENSITY, notes)
    whole = np.ones((len(filling.tetrahedra), 4))
    return CookedBody(filling, none.reshape(0, 3), none, none, position, triangles, embedding, report, whole)


def body_of_tetrahedra(mesh: TetrahedralMesh, notes: tuple[str, ...]) -> CookedBody:
    """Return the body of these tetrahedra; its skin is their outer surface."""
    number, triangles = np.unique(mesh.surface, return_inverse=True)
    corner = np.argsort(mesh.tetrahedra.ravel(), kind="stable")
    first = corner[np.searchsorted(mesh.tetrahedra.ravel()[corner], number)]  # where each vertex is a corner first
    weights = np.eye(4)[first % 4]
    embedding = Embedding((first // 4).astype(np.int32), weights)
    position, none = mesh.position[number], np.zeros(0, np.int32)
    triangles = triangles.reshape(-1, 3).astype(np.int32)
    local = position[triangles] - mean(position)
    volume = total(dot(local[:, 0], np.cross(local[:, 1], local[:, 2]))) / 6
    report = report_of(mesh, embedding, volume, DENSITY, notes)
    whole = np.ones((len(mesh.tetrahedra), 4))
    return CookedBody(mesh, none.reshape(0, 3), none, none, position, triangles, embedding, report, whole)


def scaled(body: CookedBody, scale: float) -> CookedBody:
    """Return the body, `scale` times as large. Raises InputError."""
    if scale == 1:
        return body
    notes, was = body.report.told, body.report
    with np.errstate(all="ignore"):
        mesh = TetrahedralMesh(body.mesh.position * scale, body.mesh.tetrahedra)
        size, hull = (was.voxels, np.array(was.edges) * scale, was.doubled), body.hull_position * scale
        surface, volume = (hull, body.hull_triangles) if was.voxels else None, was.hull_volume * scale**3
        report = report_of(mesh, body.embedding, volume, was.density, notes, size, body.fractions, surface)
    return replace(body, mesh=mesh, hull_position=hull, report=report)
