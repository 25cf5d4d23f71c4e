"""Report on a tetrahedral body: its size, its fidelity to the surface, and the quality of its tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softlab.model.geometry.arithmetic.ordered import dot
from softlab.model.geometry.moments import point_moments, surface_moments, tetrahedra_moments
from softlab.model.geometry.tetrahedra.embedding import Embedding
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh, check_density

SAME = 1e-9  # of a volume: two that differ by less are the same


@dataclass(frozen=True)
class Report:
    """Size and quality of a body.

    `voxels` of `edges` (3) [m], the longest of them `edge`, 0 of a body that is not of voxels, `doubled` of them several
    times there, `cut` of the tetrahedra partly outside the surface; `pieces` that hang together. `volume` and `hull_volume`
    [m^3]: of what the tetrahedra hold and within the surface, with second moments about the axes through the centre (3)
    [m^5]: `moments` of the tetrahedra, `vertex_moments` of the vertices' masses over the density, `hull_moments`.
    `worst_quality` and `mean_quality`: see TetrahedralMesh, the worst being tetrahedron `worst` at `worst_place` [m];
    `points` of the surface, `outside` of which lie beyond their tetrahedron, by `farthest` [m] at most; `density` [kg/m^3],
    `mass` [kg]; `notes`: what was mended and what to mind."""

    vertices: int
    tetrahedra: int
    voxels: int
    edge: float
    edges: tuple[float, ...]
    doubled: int
    cut: int
    pieces: int
    volume: float
    hull_volume: float
    moments: tuple[float, ...]
    vertex_moments: tuple[float, ...]
    hull_moments: tuple[float, ...]
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
        """Return the lines that describe the body to a user."""
        place = ", ".join(f"{x:.4g}" for x in self.worst_place)
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
            self._built(),
            self._volume(),
            f"quality (mean ratio, 1 of a regular one) {self.worst_quality:.4g} at worst, tetrahedron {self.worst} at "
            f"({place}); {self.mean_quality:.4g} on average",
            points,
            f"mass {self.mass:.6g} kg at {self.density:g} kg/m^3{within}",
            self._moments_line(self.density),
            *self.told,
        ]

    def brief(self, mass: float) -> list[str]:
        """Return the lines that a run prints of a body that weighs `mass` [kg], materials of regions included."""
        return [f"{self._built()}; {mass:.6g} kg, {self._volume()}", self._moments_line(mass / self.volume), *self.told]

    def _built(self) -> str:
        voxels = ""
        if self.voxels:
            doubled = f" ({self.doubled} doubled for pieces that do not touch)" if self.doubled else ""
            voxels = f", {_many(self.voxels, 'voxel')} of {_size(self.edges)}{doubled}"
        return (
            f"{_many(self.tetrahedra, 'tetrahedron', 'tetrahedra')}, {_many(self.vertices, 'vertex', 'vertices')}{voxels}, "
            f"{_many(self.pieces, 'piece')}"
        )

    def _volume(self) -> str:
        ratio = "that within the surface"
        if abs(self.volume_ratio - 1) > SAME:
            ratio = f"{self.volume_ratio:.4g} times that within the surface, {self.hull_volume:.6g} m^3"
        cut = f"; {self.cut} tetrahedra are partly outside and count by their part inside" if self.cut else ""
        return f"volume {self.volume:.6g} m^3, {ratio}{cut}"

    def _moments_line(self, density: float) -> str:
        """Moments of inertia at a `density` [kg/m^3]."""
        tetrahedra, vertices, hull = (
            ", ".join(f"{density * moment:.4g}" for moment in moments)
            for moments in (self.moments, self.vertex_moments, self.hull_moments)
        )
        return (
            f"moments of inertia about x, y, z through the centre: {tetrahedra} kg m^2 of the tetrahedra, {vertices} of the "
            f"masses at the vertices, {hull} within the surface"
        )


def report_of(
    mesh: TetrahedralMesh,
    embedding: Embedding,
    hull_volume: float,
    density: float,
    notes: tuple[str, ...] = (),
    voxels: tuple[int, float | np.ndarray, int] = (0, 0.0, 0),
    fractions: np.ndarray | None = None,
    surface: tuple[np.ndarray, np.ndarray] | None = None,
) -> Report:
    """Return the report of `mesh`, in which a surface of `hull_volume` [m^3] has the `embedding`. `voxels`: number,
    edge or edges (3) [m], number of doubled ones; `fractions` (tetrahedra, 4): fractions inside (fractions.py), by
    default 1; `surface`: (position, triangles), by default that of the tetrahedra. Raises SceneError (density)."""
    check_density(density)
    quality = mesh.quality
    worst = int(np.argmin(np.round(quality, 9)))  # the first of those that differ by roundings alone
    beyond = embedding.beyond(mesh.position, mesh.tetrahedra)
    corners = mesh.volumes[:, None] / 4 * (np.ones((len(mesh.tetrahedra), 4)) if fractions is None else fractions)
    masses = np.bincount(mesh.tetrahedra.ravel(), corners.ravel(), minlength=len(mesh.position))
    volume, _, moments = tetrahedra_moments(mesh.position[mesh.tetrahedra], dot(corners, np.ones(4)))
    hull_moments = surface_moments(*surface)[2] if surface else moments
    x, y, z = (float(x) for x in mesh.position[mesh.tetrahedra[worst]].mean(axis=0))
    crowded = int((mesh.face_counts > 2).sum()) if not voxels[0] else 0
    if crowded:
        notes = (*notes, f"{_many(crowded, 'face')} of more than two tetrahedra: parts of the body overlap")
    return Report(
        vertices=len(mesh.position),
        tetrahedra=len(mesh.tetrahedra),
        voxels=voxels[0],
        edge=float(np.max(voxels[1])),
        edges=_three(np.broadcast_to(voxels[1], 3)),
        doubled=voxels[2],
        cut=0 if fractions is None else int((fractions != 1).any(axis=1).sum()),
        pieces=mesh.pieces(),
        volume=volume,
        hull_volume=hull_volume,
        moments=_three(moments),
        vertex_moments=_three(point_moments(mesh.position, masses)[2]),
        hull_moments=_three(hull_moments),
        worst_quality=float(quality[worst]),
        worst=worst,
        worst_place=(x, y, z),
        mean_quality=float(quality.mean()),
        points=len(embedding.tetrahedron),
        outside=int((beyond > 0).sum()),
        farthest=float(beyond.max(initial=0.0)),
        density=density,
        mass=density * volume,
        told=notes,
    )


def _many(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def _size(edges: tuple[float, ...]) -> str:
    """Return the size of voxels in words: `0.1 m`, or `0.1 x 0.05 x 0.05 m` if they are not cubes."""
    sides = [f"{edge:.4g}" for edge in edges]
    return f"{sides[0] if len(set(sides)) == 1 else ' x '.join(sides)} m"


def _three(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
