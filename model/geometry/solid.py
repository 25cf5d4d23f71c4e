"""The inside of a triangle mesh: what a mesh needs to be a body, made good where that is safe, and said.

Small holes are filled, pieces that are inside out are turned over. A piece whose outer side looks inwards and that lies
within the rest is a cavity, and stays one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.core.errors import InputError
from model.geometry.arithmetic.ordered import dot, mean, norm, total
from model.geometry.edges import MeshEdges, components, mesh_edges
from model.geometry.measures import triangle_areas
from model.geometry.mesh import TriangleMesh, triangle_mesh
from model.geometry.voxels import winding_numbers

PROBES = 16  # vertices of a piece that are asked whether they lie within the others
EMPTY = 2.0**-20  # volume over that of the box around the mesh: what float32 coordinates cannot tell from 0


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh, outer sides outwards: `position` (vertices, 3) float64 [m], `triangles` (n, 3) int32; `volume` [m^3],
    what overlaps counted as often as it does; `area` [m^2]; `pieces` that are no cavities; `told`: a sentence for each
    thing that was made good."""

    position: np.ndarray
    triangles: np.ndarray
    volume: float
    area: float
    pieces: int
    told: tuple[str, ...]


CLOTH = 'a cloth: kind = "soft_sheet"'  # what a mesh without an inside can be instead


def solid(mesh: TriangleMesh, widest: float, instead: str = CLOTH) -> Solid:
    """The body of a mesh. Holes across which `widest` [m] reaches are filled: no particle lies nearer to another. `instead`:
    what to make of a mesh that is none.

    Raises InputError: wider holes, nothing inside.
    """
    told = list(mesh.repairs)
    triangles, edges = mesh.triangles, mesh.edges
    if mesh.edges.boundary.any():
        triangles = _filled(mesh, widest, instead, told)
        edges = mesh_edges(len(mesh.position), triangles)
    triangles, pieces = _outwards(mesh.position, triangles, edges, told)
    volume = total(_volumes(mesh.position, triangles))
    box = float(np.prod(np.ptp(mesh.position, axis=0)))
    if volume <= EMPTY * box:
        raise InputError(
            f"the mesh holds no volume ({volume:.3g} m^3): a flat sheet, or folded flat; give it a "
            f"thickness, or make it {instead}"
        )
    area = total(triangle_areas(mesh.position, triangles))
    return Solid(mesh.position, np.ascontiguousarray(triangles, dtype=np.int32), volume, area, pieces, tuple(told))


def as_mesh(mesh: TriangleMesh | tuple[np.ndarray, np.ndarray]) -> TriangleMesh:
    """The mesh, or that of (position (vertices, 3) [m], triangles (n, 3)), judged and mended. Raises InputError."""
    return mesh if isinstance(mesh, TriangleMesh) else triangle_mesh(*mesh)


def _volumes(position: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(triangles,) [m^3]: of the tetrahedra over each triangle, whose sum over a closed mesh is its volume."""
    a, b, c = (position[corner] - mean(position) for corner in triangles.T)
    return dot(a, np.cross(b, c)) / 6


def _filled(mesh: TriangleMesh, widest: float, instead: str, told: list[str]) -> np.ndarray:
    """(triangles, 3): with a fan from the first vertex of every rim, which may be no wider than `widest` [m]."""
    edges = mesh.edges
    # sides of triangles that have nothing beside them, the other way round: so a fan's triangles pass them
    bare = edges.boundary[edges.sides]
    end, start = mesh.triangles[bare], mesh.triangles[:, [1, 2, 0]][bare]
    label = components(len(mesh.position), np.stack([start, end], axis=1))[start]
    order = np.argsort(label, kind="stable")
    start, end, label = start[order], end[order], label[order]
    rims, first, count = np.unique(label, return_index=True, return_counts=True)
    low = np.minimum.reduceat(mesh.position[start], first)
    high = np.maximum.reduceat(mesh.position[start], first)
    across = norm(high - low)
    worst = int(np.argmax(across))
    if across[worst] > widest:
        others = f"{len(rims)} holes, the widest" if len(rims) > 1 else "a hole,"
        where = ", ".join(f"{x:.4g}" for x in (low[worst] + high[worst]) / 2)
        raise InputError(
            f"the mesh is not closed ({others} {across[worst]:.3g} m across, with {count[worst]} edges, at ({where})), so it "
            f"has no inside; close it (holes up to the spacing, {widest:.3g} m, are filled), or make it {instead}"
        )
    fan = np.stack([rims[np.searchsorted(rims, label)], start, end], axis=1)  # a rim's label is its lowest vertex
    fan = fan[(fan[:, 0] != fan[:, 1]) & (fan[:, 0] != fan[:, 2])]
    told.append(
        f"{len(rims)} hole{'s' if len(rims) > 1 else ''}, up to {across[worst]:.3g} m across, "
        f"{'were' if len(rims) > 1 else 'was'} filled with {len(fan)} triangle{'s' if len(fan) > 1 else ''}"
    )
    try:
        filled = np.concatenate([mesh.triangles, fan])
        mesh_edges(len(mesh.position), filled)
    except InputError:
        raise InputError(
            "the mesh is not closed, and its holes touch each other or run into a thin edge; close them"
        ) from None
    return filled


def _outwards(position: np.ndarray, triangles: np.ndarray, edges: MeshEdges, told: list[str]) -> tuple[np.ndarray, int]:
    """(triangles with outer sides outwards, pieces that are no cavities)."""
    if edges.boundary.any():
        raise InputError("the mesh is not closed, and its holes touch each other; close them")
    label = components(len(position), edges.edges)[triangles[:, 0]]
    pieces, piece = np.unique(label, return_inverse=True)
    # about each piece's own corner, so that the sum is exact to its own size
    local = position[triangles] - position[pieces[piece]][:, None]
    each = dot(local[:, 0], np.cross(local[:, 1], local[:, 2]))
    volume = np.bincount(piece, each)
    if total(volume) < 0:  # the whole of it, with its cavities
        triangles, volume = triangles[:, [0, 2, 1]], -volume
        told.append("the mesh was inside out, and turned over")
    inwards = volume < 0
    cavity = np.zeros(len(pieces), dtype=bool)
    if inwards.any():
        proper = np.where(inwards[piece][:, None], triangles[:, [0, 2, 1]], triangles)
        for k in np.flatnonzero(inwards):
            probe = np.unique(triangles[piece == k])
            probe = position[probe[:: max(1, len(probe) // PROBES)]]
            cavity[k] = bool((winding_numbers(probe, position, proper[piece != k]) > 0.5).all())
    turned = inwards & ~cavity
    if turned.any():
        triangles = np.where(turned[piece][:, None], triangles[:, [0, 2, 1]], triangles)
        one = turned.sum() == 1
        told.append(f"{turned.sum()} of {len(pieces)} pieces {'was' if one else 'were'} inside out, and turned over")
    return triangles, int((~cavity).sum())
