"""Blocks of a regular lattice: soft bodies whose clusters are windows, summed in passes along the axes.

A. Rivers, D. James, "FastLSM: Fast Lattice Shape Matching for Robust Real-Time Deformation", SIGGRAPH 2007.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from model.assets.baked_body import BakedBody, report_of
from model.assets.sampling import MAX_PARTICLES
from model.assets.skin import make_skin
from model.assets.soft_body import Meshes, SoftBody, check_masses
from model.core.errors import InputError, SceneError
from model.core.memory import available_bytes, require
from model.geometry.arithmetic.ordered import dot, total
from model.geometry.solid import as_mesh
from model.scene.parts import Count
from model.shape_matching.lattice import Lattice

OFF = 1e-6  # of a box's longest side: how far a corner of the mesh may be off its sides
ENTRY_BYTES = 100  # of a window's member while clusters are made
MAX_ENTRIES = 2**31 - 1  # of clusters: indices are 32-bit


class SoftLattice(SoftBody):
    """A box filled with a lattice of particles, `particle_spacing` apart, and a cluster around each of those at most `region`
    places away along each axis: the larger, the stiffer and the smoother. What a step costs hardly hangs on it."""

    lacks: ClassVar[tuple[str, ...]] = (
        "volume_sampling", "surface_sampling", "cluster_spacing", "cluster_radius", "link_radius", "link_stiffness",
    )  # fmt: skip
    lacks_reason: ClassVar[str] = "does not go with a lattice, which fills a box evenly; region says what moves as one"

    region: Count = 2

    def bake(self, mesh: Meshes) -> BakedBody:
        """See `SoftBody.from_mesh`; the mesh must be a box along the axes. Raises InputError, SceneError."""
        made = as_mesh(mesh)
        low, high = _box(made.position, made.triangles)
        with np.errstate(all="ignore"):
            along = (high - low) / self.particle_spacing
        if not np.prod(along) <= MAX_PARTICLES:
            raise SceneError(
                "particle_spacing",
                self.particle_spacing,
                f"gives more than {MAX_PARTICLES} particles; use a larger one",
            )
        counts = [max(1, round(float(side))) for side in along]
        lattice = Lattice((counts[0], counts[1], counts[2]), self.region, self.particle_spacing)
        entries = float(np.prod([axis.count.sum() for axis in lattice.axes]))
        if entries > MAX_ENTRIES:
            raise SceneError(
                "region", self.region, f"at most {MAX_ENTRIES} members of windows together; these have {entries:.3g}"
            )
        require(int(entries) * ENTRY_BYTES, available_bytes(), "region", self.region, "main memory")
        position = lattice.positions() + 0.5 * (low + high)
        volume = float(np.prod(high - low))
        total = self.density * volume if self.mass is None else self.mass
        mass = np.full(lattice.size, total / lattice.size)
        check_masses(self, mass)
        clusters = lattice.clusters(position, mass, self.cluster_stiffness)
        none = np.zeros((0, 2), np.int32)
        surface = lattice.size - int(np.prod([max(0, count - 2) for count in counts]))
        spacing, told = self.particle_spacing, made.repairs
        report = report_of(clusters, none, spacing, total, surface, told, volume=volume, hanging=1)
        skin = make_skin(made.position, made.triangles, clusters.rest_centre)
        return BakedBody(position, mass, clusters, none, np.zeros(0), 0.0, skin, spacing, report, lattice)


def _box(position: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest corner [m] of a mesh that is a box along the axes: closed, its vertices on the six sides and
    its volume theirs. Raises InputError for any other."""
    if not len(triangles):
        raise InputError("the mesh has no triangles; a lattice fills a box")
    low, high = position.min(axis=0), position.max(axis=0)
    sides = high - low
    away = np.minimum(np.abs(position - low), np.abs(position - high)).min(axis=1)
    a, b, c = (position[corner] - low for corner in triangles.T)
    volume = abs(total(dot(a, np.cross(b, c)))) / 6
    if away.max() > OFF * sides.max() or not np.isclose(volume, np.prod(sides), rtol=OFF):
        raise InputError(
            f"the mesh is no box along the axes: it holds {volume:.4g} m^3 of the {np.prod(sides):.4g} m^3 around it; a "
            'soft_lattice fills boxes, such as shape = { name = "box" }; kind = "soft_body" takes any closed mesh'
        )
    return low, high
