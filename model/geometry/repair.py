"""Closed meshes made fit for cutting: pieces that overlap united, and fewer triangles (extra `meshing`).

Pieces are united by manifold3d (E. Lalish; every result is closed), triangles reduced by libigl's `qslim`: M. Garland, P. S.
Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997, with collapses left out that would make the
surface cross itself.
"""

from __future__ import annotations

import importlib.util

import numpy as np

from softlab.model.base.errors import BackendUnavailable, InputError, SceneError
from softlab.model.geometry.arithmetic.ordered import dot, mean
from softlab.model.geometry.edges import components
from softlab.model.geometry.mesh import TriangleMesh, triangle_mesh

FEWEST = 4  # triangles that a closed surface has at least
INSTALL = 'pip install -e ".[meshing]"'


def united(position: np.ndarray, triangles: np.ndarray) -> TriangleMesh:
    """Return the closed mesh whose inside is the union of the pieces' insides; a piece that is inside out is turned
    over first. `position` (vertices, 3) [m], `triangles` (n, 3): pieces have no vertex in common, but may have them at
    the same places.

    Raises BackendUnavailable (manifold3d is not installed) and InputError (a piece that is open, or that
    `triangle_mesh` refuses).
    """
    _require("manifold3d")
    import manifold3d

    pieces: list[manifold3d.Manifold] = []
    notes: list[str] = []
    for k, piece in enumerate(_pieces(position, triangles), 1):
        notes += piece.repairs
        if piece.boundary_loops:
            holes = "a hole" if piece.boundary_loops == 1 else f"{piece.boundary_loops} holes"
            raise InputError(
                f"piece {k} has {holes}, and pieces are united only where each is closed; close it "
                "in another program, or take --tetrahedra conforming without --unite, which closes holes"
            )
        corners = (piece.position - mean(piece.position))[piece.triangles]
        outward = dot(corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0
        faces = piece.triangles if outward else piece.triangles[:, [0, 2, 1]]
        manifold = manifold3d.Manifold(manifold3d.Mesh64(piece.position, np.ascontiguousarray(faces, np.uint64)))
        if manifold.status() != manifold3d.Error.NoError:
            raise InputError(f"piece {k} bounds no volume ({manifold.status().name})")
        pieces.append(manifold)
    one = manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add).to_mesh64()
    if not len(one.tri_verts):
        raise InputError("its pieces enclose nothing")
    if len(pieces) > 1:
        notes.append(f"{len(pieces)} pieces were united: {len(triangles)} triangles became {len(one.tri_verts)}")
    return triangle_mesh(one.vert_properties[:, :3], one.tri_verts.astype(np.int64), list(dict.fromkeys(notes)))


def _pieces(position: np.ndarray, triangles: np.ndarray) -> list[TriangleMesh]:
    """Return the parts connected by the vertices' numbers; in a file without numbers (.stl), by their places."""
    number = components(len(position), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))[triangles[:, 0]]
    first, count = np.unique(number, return_counts=True)
    if count.min() < FEWEST:
        whole = triangle_mesh(position, triangles, inside=True)
        if whole.pieces == 1:
            return [whole]
        return _pieces(whole.position, whole.triangles.astype(np.int64))
    return [triangle_mesh(position, triangles[number == k], inside=True) for k in first]


def simplified(mesh: TriangleMesh, most: int) -> TriangleMesh:
    """Return the mesh with at most `most` triangles, or as few as possible without crossings. Raises BackendUnavailable
    (libigl is not installed), SceneError (most) and InputError (nothing is left).

    Raises BackendUnavailable (libigl is not installed), SceneError (most) and InputError (nothing is left).
    """
    if most < FEWEST:
        raise SceneError("--simplify", most, f"must be at least {FEWEST} triangles")
    if len(mesh.triangles) <= most:
        return mesh
    _require("igl", "libigl")
    import igl

    position, triangles = igl.qslim(
        np.asfortranarray(mesh.position), np.asfortranarray(mesh.triangles, np.int32), most, block_intersections=True
    )[:2]
    if not len(triangles):
        raise InputError(f"nothing is left of it with {most} triangles; allow more")
    note = f"{len(mesh.triangles)} triangles were simplified to {len(triangles)}"
    return triangle_mesh(position, triangles, [*mesh.repairs, note])


def _require(module: str, name: str | None = None) -> None:
    if importlib.util.find_spec(module) is None:
        raise BackendUnavailable(f"{name or module} is not installed", INSTALL)
