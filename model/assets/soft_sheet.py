"""Sheets among bodies: cloth whose particles are the vertices of a mesh, closed or not."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from softlab.model.assets.baked_body import BakedBody, report_of
from softlab.model.assets.clustering import check, gather
from softlab.model.assets.skin import make_skin
from softlab.model.assets.soft_body import Meshes, SoftBody, check_masses
from softlab.model.base.errors import InputError
from softlab.model.base.table import NotNegative, Positive
from softlab.model.geometry.arithmetic.ordered import total as sum_of
from softlab.model.geometry.measures import edge_lengths, triangle_areas
from softlab.model.geometry.solid import as_mesh


class SoftSheet(SoftBody):
    """A sheet of a mesh's vertices: links along all edges, of `link_stiffness`, hold it against stretch and shear,
    clusters, of `cluster_stiffness`, against bending. `density` is of its area; `particle_spacing`, which determines
    the clusters' spacing and the particles' radius, should be about the length of its edges."""

    lacks: ClassVar[tuple[str, ...]] = ("volume_sampling", "surface_sampling", "link_radius", "fill_holes")
    lacks_reason: ClassVar[str] = "does not apply to a sheet, whose particles are its mesh's vertices"

    density: Positive = 0.2  # kg/m^2: a shirt's
    cluster_stiffness: NotNegative = 400.0  # 1/s^2
    link_stiffness: NotNegative = 500.0  # N/m

    def bake(self, mesh: Meshes) -> BakedBody:
        """Bake as `SoftBody.from_mesh`; the mesh need not be closed."""
        surface = as_mesh(mesh)
        position, triangles = surface.position, surface.triangles
        if not len(triangles):
            raise InputError("the mesh has no triangles; a sheet needs some")
        area = triangle_areas(position, triangles)
        vertex_area = np.bincount(triangles.ravel(), np.repeat(area / 3, 3), len(position))
        total = self.density * sum_of(area) if self.mass is None else self.mass
        with np.errstate(all="ignore"):
            mass = vertex_area * (total / sum_of(area))
        check_masses(self, mass)
        links = (
            np.ascontiguousarray(surface.edges.edges, dtype=np.int32)
            if self.link_stiffness
            else np.zeros((0, 2), np.int32)
        )
        length = edge_lengths(position, links)
        spacing, radius = self.spacing_of_clusters, self.radius_of_clusters
        clusters = gather(position, mass, spacing, radius, self.cluster_stiffness)
        check(clusters, links, spacing, radius, surface.pieces)
        report = report_of(
            clusters, links, self.particle_spacing, total, len(position), surface.repairs, pieces=surface.pieces
        )
        skin = make_skin(position, triangles, clusters.rest_centre)
        return BakedBody(
            position, mass, clusters, links, length, self.link_stiffness, skin, self.particle_spacing, report
        )
