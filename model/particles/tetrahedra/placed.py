"""One tetrahedral body of a scene: cut, rotated and moved to its position, with its masses and pins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.assets.tetrahedral_body import CookedBody
from softlab.model.base.errors import SceneError, naming
from softlab.model.geometry.arithmetic.ordered import applied, total
from softlab.model.geometry.measures import rotation_about
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh
from softlab.model.particles.tetrahedra.matter import Matter, matter_of
from softlab.model.tables.regions import Region
from softlab.model.tables.selection import vertices_of
from softlab.model.tables.tetrahedra import Material, TetrahedralBody


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body at its position in the scene.

    `mesh`; `body`: the cooked body that it was made from; `matter`; `masses` (vertices,) [kg]; `velocity` (vertices, 3)
    [m/s]; `pinned`: vertices, ascending int64; `run`: tetrahedra that are swept together.
    """

    mesh: TetrahedralMesh
    body: CookedBody
    matter: Matter
    masses: np.ndarray
    velocity: np.ndarray
    pinned: np.ndarray
    run: int

    @property
    def voxels(self) -> np.ndarray:
        """Place of each tetrahedron's voxel, along the longest side first, (tetrahedra, 3) int32; 0 where there are
        none."""
        if not self.body.per_voxel:
            return np.zeros((len(self.mesh.tetrahedra), 3), np.int32)
        voxel = self.body.voxel
        longest_first = np.argsort(-np.ptp(voxel, axis=0), kind="stable")
        reordered: np.ndarray = voxel[:, longest_first]
        return reordered


def placed_body(
    name: str,
    part: TetrahedralBody,
    materials: Mapping[str, Material],
    regions: Mapping[str, Region],
    attached: Sequence[str],
) -> PlacedBody:
    """Return the body `name` of a scene with such `materials` and `regions`; `attached`: words for vertices that
    attachments pin.

    Raises SceneError, InputError, which name the body.
    """
    with naming(name, files=True):
        body = part.cooked
        if part.volume == "voxels" and not body.per_voxel:
            raise SceneError("volume", part.volume, "is of bodies cut into voxels; this file has tetrahedra alone")
        mesh = TetrahedralMesh(
            applied(rotation_about(part.axis, part.angle), body.mesh.position) + part.origin, body.mesh.tetrahedra
        )
        matter = matter_of(name, part, mesh, materials, regions)
        words = (*part.pinned, *attached)
        selected = [vertices_of(word, body.mesh.position, mesh.position, regions) for word in words]
        pinned = np.unique(np.concatenate([np.zeros(0, np.int64), *selected]))
        velocity = _velocity(part, mesh.position, lambda: matter.masses(body.mesh, body.fractions), pinned)
        masses = matter.masses(mesh, body.fractions, part.mass_ratio)
    run = max(1, body.per_voxel) if part.sweep == "voxels" else 1
    return PlacedBody(mesh, body, matter, masses, velocity, pinned, run)


def _velocity(
    part: TetrahedralBody, here: np.ndarray, masses_of: Callable[[], np.ndarray], pinned: np.ndarray
) -> np.ndarray:
    """Return the initial velocities of the vertices at `here` (particles, 3) [m], (particles, 3) [m/s]; 0 for `pinned`
    ones.

    `masses_of()` gives the axis of a spin; it is expensive, and most bodies have none.
    """
    moving = np.tile(np.asarray(part.velocity), (len(here), 1))
    if any(part.spin):
        masses = masses_of()
        moving += np.cross(np.asarray(part.spin), here - total(masses[:, None] * here) / total(masses))
    moving[pinned] = 0.0
    return moving
