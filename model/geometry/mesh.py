"""A triangle mesh: read from a file, mended where that is safe, with every repair stated.

Mended: vertices at one place become one, also along seams that rounding tore (mending/welding.py); triangles without area,
second copies of a triangle and vertices without a triangle are left out; triangles are turned over until neighbours agree on
the outer side. Refused: coordinates that are not finite, edges of more than two triangles where the mesh is to be a cloth,
surfaces with one side only. Holes and several pieces are allowed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.base.waiting import work
from softlab.model.geometry.edges import MeshEdges, edge_uses, mesh_edges
from softlab.model.geometry.mending.hull import bounding
from softlab.model.geometry.mending.welding import add_note, flip_mask, many, welded
from softlab.model.geometry.mesh_files import check_indices, check_vertices, read_arrays, rows_of_three


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles whose neighbours have the same outer side (their corners run the same way round).

    `position` (vertices, 3) float64 [m]; `triangles` (n, 3) int32; `edges`: adjacency; `repairs`: a sentence for each
    kind of repair; `pieces`: connected components; `boundary_loops`: outer rims and rims of holes; `numbering`
    (vertices of the file,) int32: vertex of the mesh for each, -1 if omitted.
    """

    position: np.ndarray
    triangles: np.ndarray
    edges: MeshEdges
    repairs: tuple[str, ...]
    pieces: int
    boundary_loops: int
    numbering: np.ndarray

    def lines(self) -> list[str]:
        """Return the lines that describe the mesh to a user: sizes, pieces, rims, repairs."""
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.position, axis=0))
        euler = len(self.position) - len(self.edges.edges) + len(self.triangles)
        rims = many(self.boundary_loops, "rim") if self.boundary_loops else "closed"
        return [
            f"{len(self.position)} vertices, {len(self.edges.edges)} edges, {len(self.triangles)} triangles "
            f"(Euler characteristic {euler}), {many(self.pieces, 'piece')}, {rims}, {size} m",
            *self.repairs,
        ]


def mesh_bytes(mesh: TriangleMesh | tuple[np.ndarray, np.ndarray]) -> bytes:
    """Return bytes that identify a mesh, or its position and triangles, for the keys of objects built from it."""
    position, triangles = mesh if isinstance(mesh, tuple) else (mesh.position, mesh.triangles)
    position, triangles = np.asarray(position, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    repairs = [] if isinstance(mesh, tuple) else mesh.repairs
    header = f"arrays {position.shape} {triangles.shape} {json.dumps(repairs)} "
    return header.encode() + position.tobytes() + triangles.tobytes()


def read_mesh(path: str | Path, scale: float = 1.0, inside: bool = False) -> TriangleMesh:
    """Return the mesh in a file (formats: model/geometry/mesh_files.py), coordinates times `scale` [m per unit of the file].

    `inside`: see `triangle_mesh`. Vertices and triangles keep the file's order. Raises InputError (see `read_arrays`
    and `triangle_mesh`) and SceneError (scale).
    """
    position, triangles, notes = read_arrays(path, scale)
    try:
        return triangle_mesh(position, triangles, list(notes), inside)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from None


@work("mending the mesh")
def triangle_mesh(
    position: np.ndarray, triangles: np.ndarray, repairs: list[str] | None = None, inside: bool = False
) -> TriangleMesh:
    """Return the mesh of `position` (vertices, 3) [m] and `triangles` (n, 3), indices into it, mended; `repairs` made before.

    `inside`: only the enclosed volume is needed. Where edges have more than two triangles it becomes the sheets that
    bound a volume (model/geometry/mending/hull.py) instead of being refused.

    Raises InputError: a coordinate that is not finite or over LARGEST, an index out of range, no triangle with an area,
    non-manifold edges (NonManifold), a surface that cannot have an outer side.
    """
    position = rows_of_three("position", position, np.float64)
    triangles = rows_of_three("triangles", triangles, np.int64)
    check_vertices(position)
    check_indices(len(position), triangles)
    notes = list(repairs or [])
    place, triangles = welded(position, triangles, notes)
    if inside and (edge_uses(len(position), triangles)[1] > 2).any():
        source, points, triangles = bounding(position, triangles, notes)
        mesh = _finished(points, triangles, np.arange(len(points)), [])
        numbering = np.full(len(position), -1, dtype=np.int32)
        numbering[source[::-1]] = mesh.numbering[: len(source)][::-1]  # of several the first
        return replace(mesh, numbering=numbering[place], repairs=(*notes, *mesh.repairs))
    return _finished(position, triangles, place, notes)


def _finished(position: np.ndarray, triangles: np.ndarray, place: np.ndarray, notes: list[str]) -> TriangleMesh:
    """Return the mesh of `triangles` (n, 3) of merged vertices; `place` (vertices,): the merged index of each."""
    merged = int((place != np.arange(len(place))).sum())
    numbering, position, triangles = _without_unused(position, triangles, place, merged, notes)
    edges = mesh_edges(len(position), triangles)
    over = flip_mask(edges)
    if over.any():
        triangles[over] = triangles[over][:, [0, 2, 1]]
        edges = mesh_edges(len(position), triangles)
        one, many = "was turned over to agree with its neighbours", "were turned over to agree with their neighbours"
        add_note(notes, int(over.sum()), f"triangle {one}", f"triangles {many}")
    return TriangleMesh(
        position, triangles, edges, tuple(notes), edges.parts(), edges.boundary_loops(), numbering.astype(np.int32)
    )


def with_triangles(mesh: TriangleMesh, position: np.ndarray, triangles: np.ndarray, repairs: list[str]) -> TriangleMesh:
    """Return `mesh` with vertices added behind the existing ones, `position` (vertices, 3) [m] in all, other triangles, and
    `repairs`. Raises NonManifold.
    """
    edges = mesh_edges(len(position), triangles)
    return TriangleMesh(
        position, np.ascontiguousarray(triangles, dtype=np.int32), edges, tuple(repairs), edges.parts(),
        edges.boundary_loops(), mesh.numbering,
    )  # fmt: skip


def _without_unused(
    position: np.ndarray, triangles: np.ndarray, place: np.ndarray, merged: int, notes: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (numbering, position, triangles): vertices of a triangle, numbered in the file's order."""
    used = np.zeros(len(position), dtype=bool)
    used[triangles] = True
    unused = len(position) - merged - int(used.sum())
    add_note(notes, unused, "vertex that no triangle uses was left out", "vertices that no triangle uses were left out")
    number = np.where(used, np.cumsum(used) - 1, -1)
    return number[place], position[used], number[triangles].astype(np.int32)
