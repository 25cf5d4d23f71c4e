"""One tetrahedral body of a scene: cut, turned and moved to its place, with its masses and what pins it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from model.assets.cooked import cooked, is_settled
from model.assets.tetrahedral_body import CookedBody
from model.core.errors import InputError, SceneError
from model.geometry.arithmetic.ordered import applied, total
from model.geometry.measures import turned_about
from model.geometry.tetrahedra.mesh import TetrahedralMesh
from model.geometry.topology import mesh_path
from model.scene.regions import Region
from model.scene.tetrahedra import Material, TetrahedralBody
from model.tetrahedra.matter import Matter, matter_of
from model.tetrahedra.selection import vertices_of


@dataclass(frozen=True, eq=False)
class PlacedBody:
    """A body where the scene has it: its `mesh`, what it was cut from and became (`body`), `matter`, `masses` (vertices,)
    [kg], `velocity` (vertices, 3) [m/s], `pinned` vertices, ascending int64; `run`: tetrahedra that are swept together."""

    mesh: TetrahedralMesh
    body: CookedBody
    matter: Matter
    masses: np.ndarray
    velocity: np.ndarray
    pinned: np.ndarray
    run: int

    @property
    def voxels(self) -> np.ndarray:
        """(tetrahedra, 3) int32: the place of each one's voxel, along the longest side first; 0 where there are none."""
        if not self.body.per_voxel:
            return np.zeros((len(self.mesh.tetrahedra), 3), np.int32)
        voxel = self.body.voxel
        longest_first = np.argsort(-np.ptp(voxel, axis=0), kind="stable")
        found: np.ndarray = voxel[:, longest_first]
        return found


def placed_body(
    name: str,
    part: TetrahedralBody,
    materials: Mapping[str, Material],
    regions: Mapping[str, Region],
    attached: Sequence[str],
) -> PlacedBody:
    """The body `name` of a scene with such `materials` and `regions`; `attached`: words for vertices that attachments pin.
    Raises SceneError, InputError, which name the body."""
    try:
        body = cut(part)
        if part.volume == "voxels" and not body.per_voxel:
            raise SceneError("volume", part.volume, "is of bodies cut into voxels; this file has tetrahedra alone")
        mesh = TetrahedralMesh(
            applied(turned_about(part.axis, part.angle), body.mesh.position) + part.origin, body.mesh.tetrahedra
        )
        matter = matter_of(name, part, mesh, materials, regions)
        words = (*part.pinned, *attached)
        held = [vertices_of(word, body.mesh.position, mesh.position, regions) for word in words]
        pinned = np.unique(np.concatenate([np.zeros(0, np.int64), *held]))
        velocity = _velocity(part, mesh.position, matter.masses(body.mesh, body.fractions), pinned)
        masses = matter.masses(mesh, body.fractions, part.mass_ratio)
    except SceneError as error:
        raise SceneError(f"{name}.{error.field}", error.value, error.allowed) from None
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    run = max(1, body.per_voxel) if part.sweep == "voxels" else 1
    return PlacedBody(mesh, body, matter, masses, velocity, pinned, run)


def cut(part: TetrahedralBody) -> CookedBody:
    """The body where its mesh lies, neither turned nor moved; kept on disk. Raises InputError, SceneError."""
    source = part.shape or mesh_path(part.file or "")
    voxels = None if part.edge is not None or is_settled(source) else part.voxels
    return cooked(
        source, edge=part.edge, voxels=voxels, per_voxel=part.tetrahedra, scale=part.scale, density=part.density,
        fill_holes=part.fill_holes,
    )  # fmt: skip


def _velocity(part: TetrahedralBody, here: np.ndarray, masses: np.ndarray, pinned: np.ndarray) -> np.ndarray:
    """(particles, 3) [m/s]: how fast those `here` (particles, 3) [m] are at the start, where they are not `pinned`."""
    mass = masses[:, None]
    centre = total(mass * here) / total(masses)
    moving = np.asarray(part.velocity) + np.cross(np.asarray(part.spin), here - centre)
    moving[pinned] = 0.0
    return moving
