"""A triangle mesh for cloth: read from a file, mended where that is safe, with every repair stated.

Mended: vertices at one place become one; triangles without area, second copies of a triangle and vertices without a
triangle are left out; triangles are turned over until neighbours agree on the outer side. Refused: coordinates that are not
finite, edges of more than two triangles, surfaces with one side only. Holes and several pieces are a cloth's right.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from model.core.errors import InputError, SceneError
from model.geometry.arithmetic.ordered import dot
from model.geometry.edges import MeshEdges, components, mesh_edges
from model.geometry.mesh_files import read_arrays

FLAT = 2.0**-20  # height over longest side of a triangle without an area: what float32, as in STL, cannot tell from 0
LARGEST = 1e9  # m: products of four lengths, as in squared areas, stay inside float32
MAX_VERTICES = 2**31 // 6  # indices of half edges are 32-bit


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A surface of triangles whose neighbours have the same outer side (their corners run the same way round).

    `position` (vertices, 3) float64 [m]; `triangles` (n, 3) int32; `edges`: what lies beside what; `repairs`: a sentence for
    each kind of mending; `pieces` that hang together; `boundary_loops`: rims of holes and outer ones; `numbering` (vertices
    of the file,) int32: what became of each, -1 where left out.
    """

    position: np.ndarray
    triangles: np.ndarray
    edges: MeshEdges
    repairs: tuple[str, ...]
    pieces: int
    boundary_loops: int
    numbering: np.ndarray

    def lines(self) -> list[str]:
        """What to tell a user of it: sizes, pieces, rims, repairs."""
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.position, axis=0))
        euler = len(self.position) - len(self.edges.edges) + len(self.triangles)
        rims = _many(self.boundary_loops, "rim") if self.boundary_loops else "closed"
        return [
            f"{len(self.position)} vertices, {len(self.edges.edges)} edges, {len(self.triangles)} triangles "
            f"(Euler characteristic {euler}), {_many(self.pieces, 'piece')}, {rims}, {size} m",
            *self.repairs,
        ]


def mesh_bytes(mesh: TriangleMesh | tuple[np.ndarray, np.ndarray]) -> bytes:
    """All that tells a mesh, or its position and triangles, from another one: for keys of what is made of it."""
    position, triangles = mesh if isinstance(mesh, tuple) else (mesh.position, mesh.triangles)
    position, triangles = np.asarray(position, dtype=np.float64), np.asarray(triangles, dtype=np.int64)
    told = [] if isinstance(mesh, tuple) else mesh.repairs
    header = f"arrays {position.shape} {triangles.shape} {json.dumps(told)} "
    return header.encode() + position.tobytes() + triangles.tobytes()


def read_mesh(path: str | Path, scale: float = 1.0) -> TriangleMesh:
    """The mesh in an OBJ, STL or PLY file, coordinates times `scale` [m per unit of the file].

    Vertices and triangles keep the file's order. Raises InputError (unreadable, cut short, no triangles, or what
    `triangle_mesh` refuses) and SceneError (scale).
    """
    if not (isfinite(scale) and scale > 0):
        raise SceneError("scale", scale, "must be a finite number greater than 0")
    position, triangles, more = read_arrays(Path(path))
    split = [f"faces of more than three corners were split: {len(triangles) - more} faces, {len(triangles)} triangles"]
    with np.errstate(over="ignore"):
        position = position * scale
    try:
        return triangle_mesh(position, triangles, split if more else [])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def triangle_mesh(position: np.ndarray, triangles: np.ndarray, repairs: list[str] | None = None) -> TriangleMesh:
    """The mesh of `position` (vertices, 3) [m] and `triangles` (n, 3), indices into it, mended; `repairs` made before.

    Raises InputError: a coordinate that is not finite or over LARGEST, no triangle with an area, non-manifold edges, a
    surface that cannot have an outer side.
    """
    position = np.asarray(position, dtype=np.float64).reshape(-1, 3)
    triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    check_vertices(position)
    told = list(repairs or [])
    place = _places(position)
    merged = int((place != np.arange(len(place))).sum())
    _tell(
        told,
        merged,
        "vertex at the place of another was merged with it",
        "vertices at the place of another were merged",
    )
    triangles = place[triangles]
    triangles = without_flat(position, triangles, told)
    triangles = _without_copies(len(position), triangles, told)
    numbering, position, triangles = _without_unused(position, triangles, place, merged, told)
    edges = mesh_edges(len(position), triangles)
    turned = _turned(edges)
    if turned.any():
        triangles[turned] = triangles[turned][:, [0, 2, 1]]
        edges = mesh_edges(len(position), triangles)
        one, many = "was turned over to agree with its neighbours", "were turned over to agree with their neighbours"
        _tell(told, int(turned.sum()), f"triangle {one}", f"triangles {many}")
    return TriangleMesh(
        position, triangles, edges, tuple(told), edges.parts(), edges.boundary_loops(), numbering.astype(np.int32)
    )


def _many(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def _tell(told: list[str], count: int, one: str, many: str) -> None:
    if count:
        told.append(_many(count, one, many))


def check_vertices(position: np.ndarray) -> None:
    """Raises InputError for coordinates (vertices, 3) that are not finite or over LARGEST, or more than MAX_VERTICES."""
    wrong = ~np.isfinite(position).all(axis=1)
    if wrong.any():
        vertex, many = int(np.argmax(wrong)), _many(int(wrong.sum()), "vertex", "vertices")
        raise InputError(
            f"{many} without finite coordinates, first vertex {vertex} (counted from 0), {position[vertex].tolist()}; export "
            "the mesh again"
        )
    if len(position) > MAX_VERTICES:
        raise InputError(f"{len(position)} vertices; at most {MAX_VERTICES} (32-bit indices): decimate the mesh")
    size = float(np.abs(position).max(initial=0.0))
    if size > LARGEST:
        raise InputError(
            f"a coordinate of {size:.3g} m; at most {LARGEST:g}: give a scale that turns the file's unit to m"
        )


def _places(position: np.ndarray) -> np.ndarray:
    """(vertices,) int64: the first vertex at exactly the same place as each."""
    order = np.lexsort(position.T)
    ordered = position[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])[: len(order)]
    place = np.empty(len(order), dtype=np.int64)
    place[order] = order[new][np.cumsum(new) - 1]  # lexsort is stable: the first of equal ones has the lowest index
    return place


def without_flat(position: np.ndarray, triangles: np.ndarray, told: list[str]) -> np.ndarray:
    """The triangles (n, 3) that have an area; how many have none is added to `told`. Raises InputError where none has."""
    a, b, c = (position[corner] for corner in triangles.T)
    one, two, three = b - a, c - b, a - c
    longest = np.maximum(np.maximum(_squares(one), _squares(two)), _squares(three))
    double_area = np.sqrt(_squares(np.cross(one, two)))
    keep = double_area > FLAT * longest
    if not keep.any():
        raise InputError(f"none of its {len(triangles)} triangles has an area; is it a set of lines or points?")
    _tell(told, int((~keep).sum()), "triangle without area was left out", "triangles without area were left out")
    return triangles[keep]


def _squares(vectors: np.ndarray) -> np.ndarray:
    """(n,): squared lengths of `vectors` (n, 3)."""
    return dot(vectors, vectors)


def _without_copies(vertex_count: int, triangles: np.ndarray, told: list[str]) -> np.ndarray:
    low, middle, high = np.sort(triangles, axis=1).T
    _, pair = np.unique(low * vertex_count + middle, return_inverse=True)
    _, first = np.unique(pair * vertex_count + high, return_index=True)
    count = len(triangles) - len(first)
    _tell(told, count, "duplicate triangle was left out", "duplicate triangles were left out")
    return triangles[np.sort(first)] if count else triangles


def _without_unused(
    position: np.ndarray, triangles: np.ndarray, place: np.ndarray, merged: int, told: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(numbering, position, triangles): vertices of a triangle, numbered in the file's order."""
    used = np.zeros(len(position), dtype=bool)
    used[triangles] = True
    unused = len(position) - merged - int(used.sum())
    _tell(told, unused, "vertex that no triangle uses was left out", "vertices that no triangle uses were left out")
    number = np.where(used, np.cumsum(used) - 1, -1)
    return number[place], position[used], number[triangles].astype(np.int32)


def _turned(edges: MeshEdges) -> np.ndarray:
    """(triangles,) bool: those to turn over so that every two neighbours pass their edge in opposite directions.

    The lesser part of each surface; of equal parts the one without the first triangle. Each triangle stands twice in a
    graph, as it is and turned over, joined to the neighbours it agrees with: a surface has two sides where that falls in two.
    """
    count = len(edges.corners)
    turned = np.zeros(count, dtype=bool)
    if not edges.alike.any():
        return turned
    one, two = edges.triangles[edges.inner].T.astype(np.int64)
    other = two + count * edges.alike
    label = components(
        2 * count,
        np.concatenate([np.stack([one, other], 1), np.stack([one + count, (other + count) % (2 * count)], 1)]),
    )
    as_is, over = label[:count], label[count:]
    if (as_is == over).any():
        triangle = int(np.argmax(as_is == over))
        raise InputError(
            f"the surface of triangle {triangle} has one side only (a Moebius strip): walking across its edges leads back to "
            "it the other way round; cut it open along a row of edges"
        )
    turned = as_is > over  # the sheet with the surface's first triangle has the lowest label
    surface = np.minimum(as_is, over)
    part = np.bincount(surface, turned, count)
    return turned ^ (2 * part > np.bincount(surface, minlength=count))[surface]
