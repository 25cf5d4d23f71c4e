"""What is told of a tetrahedral body: its size, how true it is to its surface, how well it is shaped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.geometry.tetrahedra.embedding import Embedding
from model.geometry.tetrahedra.mesh import TetrahedralMesh, check_density

SAME = 1e-9  # of a volume: two that differ by less are the same


@dataclass(frozen=True)
class Report:
    """`voxels` of `edge` [m], 0 and 0.0 of a body that is not of voxels, `doubled` of them several times there; `pieces` that
    hang together; `volume` and `hull_volume` [m^3], of the tetrahedra and within the surface; `worst_quality` and
    `mean_quality`: see TetrahedralMesh, the worst being tetrahedron `worst` at `worst_place` [m]; `points` of the surface,
    `outside` of which lie beyond their tetrahedron, by `farthest` [m] at most; `density` [kg/m^3], `mass` [kg]; `told`: what
    was mended and what to mind."""

    vertices: int
    tetrahedra: int
    voxels: int
    edge: float
    doubled: int
    pieces: int
    volume: float
    hull_volume: float
    worst_quality: float
    worst: int
    worst_place: tuple[float, float, float]
    mean_quality: float
    points: int
    outside: int
    farthest: float
    density: float
    mass: float
    told: tuple[str, ...]

    @property
    def volume_ratio(self) -> float:
        """Volume of the tetrahedra over that within the surface."""
        return self.volume / self.hull_volume

    def lines(self) -> list[str]:
        """What to tell a user of it."""
        voxels = ""
        if self.voxels:
            doubled = f" ({self.doubled} doubled for pieces that do not touch)" if self.doubled else ""
            voxels = f", {_many(self.voxels, 'voxel')} of {self.edge:.4g} m{doubled}"
        place = ", ".join(f"{x:.4g}" for x in self.worst_place)
        ratio = "that within the surface"
        if abs(self.volume_ratio - 1) > SAME:
            ratio = f"{self.volume_ratio:.4g} times that within the surface, {self.hull_volume:.6g} m^3"
        points = f"{_many(self.points, 'point')} of the surface, none outside its tetrahedron"
        if self.outside:
            points = (
                f"{_many(self.points, 'point')} of the surface, {self.outside} outside the tetrahedron, the farthest by "
                f"{self.farthest:.3g} m"
            )
        within = ""
        if abs(self.volume_ratio - 1) > SAME:
            within = f"; what lies within the surface would have {self.density * self.hull_volume:.6g} kg"
            within += f", as the body has with density = {self.density / self.volume_ratio:.4g}"
        return [
            f"{_many(self.tetrahedra, 'tetrahedron', 'tetrahedra')}, {_many(self.vertices, 'vertex', 'vertices')}{voxels}, "
            f"{_many(self.pieces, 'piece')}",
            f"volume {self.volume:.6g} m^3, {ratio}",
            f"quality (mean ratio, 1 of a regular one) {self.worst_quality:.4g} at worst, tetrahedron {self.worst} at "
            f"({place}); {self.mean_quality:.4g} on average",
            points,
            f"mass {self.mass:.6g} kg at {self.density:g} kg/m^3{within}",
            *self.told,
        ]


def report_of(
    mesh: TetrahedralMesh,
    embedding: Embedding,
    hull_volume: float,
    density: float,
    told: tuple[str, ...] = (),
    voxels: tuple[int, float, int] = (0, 0.0, 0),
) -> Report:
    """The report of `mesh`, whose surface of `hull_volume` [m^3] is carried by `embedding`; `voxels`: how many, their edge
    [m], how many are doubled. Raises SceneError (density)."""
    check_density(density)
    worst = int(np.argmin(mesh.quality))
    beyond = embedding.beyond(mesh.position, mesh.tetrahedra)
    volume = float(mesh.volumes.sum())
    x, y, z = (float(x) for x in mesh.position[mesh.tetrahedra[worst]].mean(axis=0))
    crowded = int((mesh.face_counts > 2).sum()) if not voxels[0] else 0
    if crowded:
        told = (*told, f"{_many(crowded, 'face')} of more than two tetrahedra: parts of the body overlap")
    return Report(
        vertices=len(mesh.position),
        tetrahedra=len(mesh.tetrahedra),
        voxels=voxels[0],
        edge=voxels[1],
        doubled=voxels[2],
        pieces=mesh.pieces(),
        volume=volume,
        hull_volume=hull_volume,
        worst_quality=float(mesh.quality[worst]),
        worst=worst,
        worst_place=(x, y, z),
        mean_quality=float(mesh.quality.mean()),
        points=len(embedding.tetrahedron),
        outside=int((beyond > 0).sum()),
        farthest=float(beyond.max(initial=0.0)),
        density=density,
        mass=density * volume,
        told=told,
    )


def _many(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"
