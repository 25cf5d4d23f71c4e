"""Tetrahedra of voxels: the simulation mesh of a body, in which its surface is embedded.

A voxel exists where the body overlaps it: where its surface passes through (overlap.py), or where all of it is inside. Each
becomes five tetrahedra or six. A voxel in which the body has pieces that do not touch there, as fingers nearer to each other
than a voxel, is doubled: one for each piece (pieces.py, which lists the limits). Neighbours share the four vertices of a side
where the body hangs together across it, and only there; so pieces share vertices where they meet around the vertex, and
nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Literal

import numpy as np

from softlab.model.base.errors import SceneError
from softlab.model.base.memory import available_bytes, readable
from softlab.model.geometry.arithmetic.ordered import applied, determinant, dot
from softlab.model.geometry.edges import components
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.mesh_files import LARGEST
from softlab.model.geometry.normals import mesh_normals
from softlab.model.geometry.solid import CLOTH, Solid, as_mesh, filled, solid
from softlab.model.geometry.tetrahedra.embedding import Embedding
from softlab.model.geometry.tetrahedra.fractions import fractions_of
from softlab.model.geometry.tetrahedra.meeting import Cells
from softlab.model.geometry.tetrahedra.mesh import TetrahedralMesh
from softlab.model.geometry.tetrahedra.overlap import EIGHT, triangles_in_voxels
from softlab.model.geometry.tetrahedra.pieces import Pieces, pieces_of
from softlab.model.geometry.voxels import runs_inside

VOXELS = 10  # along the longest axis, unless given
MOST_VOXELS = 1 << 20  # along an axis: the number of a voxel stays inside 64 bits
FLATTEST = 100  # times as long as it is high, a voxel that fits into a thin body
WHOLE = 1e-9  # of a voxel: a surface so near to the lattice lies on it
COARSEST = (
    2.0**-30
)  # of the largest coordinate: what the edge of a voxel must be over, or its corners are rounded together
BYTES_PER_VOXEL = 5000  # of memory while it is made: 4500 seen
BYTES_PER_TRIANGLE = 6000  # and for each voxel that a triangle is long: 500 seen of small ones, 5000 of long ones

PerVoxel = Literal[5, 6]


def _oriented(tetrahedra: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Return (n, 4): of corners by their numbers, x y z in binary, with two of them swapped where the volume was
    negative."""
    corners = np.array(tetrahedra)
    place = EIGHT[corners].astype(np.float64)
    wrong = determinant(place[:, 1:] - place[:, :1]) < 0
    corners[wrong] = corners[wrong][:, [0, 1, 3, 2]]
    return corners


_FIVE = [(0, 6, 5, 3), (4, 0, 6, 5), (2, 0, 6, 3), (1, 0, 5, 3), (7, 6, 5, 3)]
_SIX = [(0, 1 << a, (1 << a) + (1 << b), 7) for a, b, _ in permutations(range(3))]  # H. W. Kuhn (1960)
# by the parity of x + y + z: five alternate, each the mirror image of its neighbours, or the sides' diagonals would not meet
CUTS = {
    5: np.stack([_oriented(_FIVE), _oriented([tuple(corner ^ 4 for corner in corners) for corners in _FIVE])]),
    6: np.stack([_oriented(_SIX)] * 2),
}


@dataclass(frozen=True, eq=False)
class VoxelMesh:
    """A body of voxels cut into tetrahedra.

    Tetrahedra stand by colour, then by voxel: `voxel` (n, 3) int32, `colour` (n,) int32, 4 (x % 2) + 2 (y % 2) + z % 2;
    those of a voxel, all of its copies together, are `starts[v]` to `starts[v + 1]`, int32 (voxels + 1,). Tetrahedra of one
    colour share a vertex only within a voxel, so that the voxels of a colour may be worked on at once, each in sequence.
    `embedding`: of the vertices of `hull`, the closed surface that it was made from. `edges` (3,) [m] of a voxel along each
    axis, `edge` the longest; `origin` (3,) [m]: where voxel (0, 0, 0) begins; `doubled`: voxels that there are several times;
    `fractions` (n, 4): see fractions.py, 1 of a tetrahedron that lies within the surface.
    """

    mesh: TetrahedralMesh
    voxel: np.ndarray
    colour: np.ndarray
    starts: np.ndarray
    embedding: Embedding
    hull: Solid
    edges: np.ndarray
    origin: np.ndarray
    doubled: int
    fractions: np.ndarray

    @property
    def edge(self) -> float:
        """[m]"""
        return float(self.edges.max())


def voxel_mesh(
    mesh: TriangleMesh | tuple[np.ndarray, np.ndarray],
    *,
    edge: float | None = None,
    voxels: int | None = None,
    per_voxel: PerVoxel = 5,
) -> VoxelMesh:
    """Return the body of a closed mesh in voxels of at most `edge` [m], or `voxels` of them along the longest side of
    the box around it (10 unless given). A whole number of voxels fills that box along each axis, so that a box in line
    with the axes is met exactly; they are cubes where its sides are multiples of `edge`.

    Raises SceneError (a parameter) and InputError (an open mesh, nothing inside, coordinates beyond those of a body).
    """
    mesh = filled(
        as_mesh(mesh, inside=True), 0.0, f'a body with tetrahedra = "conforming", which closes holes, {CLOTH}'
    )
    hull = solid(mesh, 0.0)
    low, high = hull.position.min(axis=0), hull.position.max(axis=0)
    size, counts = _lattice(hull, low, high, edge, voxels, per_voxel)
    origin = (low + high) / 2 - counts * size / 2
    place = (hull.position - origin) / size
    slack = _slack(hull, float(size.min()))
    near = np.round(place)
    snapped = np.clip(np.where(np.abs(place - near) <= slack, near, place), 0, counts)
    triangle, through = triangles_in_voxels(snapped, hull.triangles, counts)
    centres = runs_inside(snapped, hull.triangles, 1.0, (np.full(3, 0.5), counts))
    cells = Cells(np.concatenate([through, *(index for index, _ in centres.points())]), counts)
    pairs = triangle, cells.number(through)
    pieces = pieces_of(snapped, hull.triangles, mesh.edges, cells, pairs)
    return _cut(hull, place, snapped, cells, pieces, pairs, (origin, size, per_voxel))


def _slack(hull: Solid, size: float) -> float:
    """Return the distance from the lattice, in voxels, up to which a point counts as on it."""
    return max(WHOLE, 8 * float(np.finfo(np.float64).eps) * float(np.abs(hull.position).max()) / size)


def _lattice(
    hull: Solid, low: np.ndarray, high: np.ndarray, edge: float | None, voxels: int | None, per_voxel: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (edges of a voxel (3,) [m], how many along each axis (3,) int64)."""
    if per_voxel not in CUTS:
        raise SceneError("tetrahedra", per_voxel, "must be 5 or 6 a voxel")
    field: tuple[str, object] = ("voxels", voxels) if edge is None else ("edge", edge)
    advice = "take fewer" if edge is None else "make them larger"
    size = edge_of(hull.position, edge, voxels)
    largest = float(np.abs(hull.position).max())
    if size < COARSEST * largest:
        reason = f"makes voxels of {size:.3g} m at coordinates of {largest:.3g} m, below what these can resolve"
        raise SceneError(*field, f"{reason}; move the mesh to the origin, or {advice}")
    wide = (high - low) / size
    if wide.max() > MOST_VOXELS:
        raise SceneError(*field, f"makes {wide.max():.3g} voxels along an axis; at most {MOST_VOXELS}: {advice}")
    counts = np.maximum(np.ceil(wide - 2 * _slack(hull, size)), 1).astype(np.int64)
    some = min(float(np.prod(wide + 1)), hull.volume / size**3 + 2 * hull.area / size**2 + 8)
    spanned = len(hull.triangles) + float(np.ptp(hull.position[hull.triangles], axis=1).max(axis=1).sum()) / size
    needed, free = some * BYTES_PER_VOXEL + spanned * BYTES_PER_TRIANGLE, available_bytes()
    if needed > free:
        raise SceneError(
            *field,
            f"makes about {some:.3g} voxels, which take {readable(needed)} of memory, of which {readable(free)} is free; "
            + advice,
        )
    fitted = np.maximum((high - low) / counts, max(size / FLATTEST, COARSEST * largest))
    return np.where(np.abs(wide - counts) <= 2 * _slack(hull, size), size, fitted), counts


def edge_of(position: np.ndarray, edge: float | None, voxels: int | None) -> float:
    """[m]: `edge`, or that of so many `voxels` along the longest side of the box around `position` (vertices, 3) [m]. Raises
    SceneError."""
    if edge is not None and voxels is not None:
        raise SceneError("voxels", voxels, "give voxels or edge, not both")
    if edge is not None and not 0 < edge <= LARGEST:
        raise SceneError("edge", edge, f"must be a number greater than 0 and at most {LARGEST:g} [m]")
    if voxels is not None and not 1 <= voxels <= MOST_VOXELS:
        raise SceneError("voxels", voxels, f"must be 1 to {MOST_VOXELS} along the longest axis")
    return float(np.ptp(position, axis=0).max()) / (voxels or VOXELS) if edge is None else float(edge)


def _cut(
    hull: Solid,
    place: np.ndarray,
    snapped: np.ndarray,
    cells: Cells,
    pieces: Pieces,
    pairs: tuple[np.ndarray, np.ndarray],
    lattice: tuple[np.ndarray, np.ndarray, int],
) -> VoxelMesh:
    """Return the tetrahedra of `pieces`, and the vertices of the hull in them."""
    origin, size, per_voxel = lattice
    piece = _piece_of_vertices(hull, snapped, cells, pieces, pairs)
    node, vertex = _shared(pieces)
    every = cells.index[pieces.voxel]
    position = origin + (every[node // 8] + EIGHT[node % 8]) * size
    same = _copies(pieces.voxel, vertex)
    unique = np.flatnonzero(same == np.arange(len(same)))
    piece = np.searchsorted(unique, same[piece])
    numbers, vertex, index = pieces.voxel[unique], vertex[unique], every[unique]
    colour = dot(index % 2, np.array([4, 2, 1]))
    order = np.lexsort((numbers, colour))
    parity = index.sum(axis=1) % 2
    corners = np.take_along_axis(vertex[:, None], CUTS[per_voxel][parity], axis=2)[order]
    voxel = numbers[order]
    begins = np.flatnonzero(np.concatenate([[True], voxel[1:] != voxel[:-1]]))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    functions = _shape_functions(per_voxel)
    tetrahedron, weights = _weights(place - index[piece], parity[piece], functions)
    inside = fractions_of(pieces, same, every.sum(axis=1) % 2, functions, hull.volume / float(np.prod(size)))
    return VoxelMesh(
        TetrahedralMesh(position, corners.reshape(-1, 4)),
        np.repeat(index[order], per_voxel, axis=0).astype(np.int32),
        np.repeat(colour[order], per_voxel).astype(np.int32),
        (np.append(begins, len(voxel)) * per_voxel).astype(np.int32),
        Embedding((rank[piece] * per_voxel + tetrahedron).astype(np.int32), weights),
        hull,
        size,
        origin,
        int((np.bincount(numbers) > 1).sum()),
        inside[unique][order].reshape(-1, 4),
    )


def _shared(pieces: Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Return (of each vertex a corner of a piece, 8 piece + corner (vertices,); the vertices at each piece's corners
    (pieces, 8)): pieces that are joined across a side share its four corners."""
    corner = np.arange(8 * len(pieces.voxel)).reshape(-1, 8)
    ends = []
    for axis, joined in enumerate(pieces.joined):
        upper = np.flatnonzero(EIGHT[:, axis])
        ends.append(np.stack([corner[joined[:, :1], upper], corner[joined[:, 1:], upper - (4 >> axis)]], axis=-1))
    label = components(corner.size, np.concatenate([end.reshape(-1, 2) for end in ends]))
    node, vertex = np.unique(label, return_inverse=True)
    return node, vertex.reshape(-1, 8)


def _copies(voxel: np.ndarray, vertex: np.ndarray) -> np.ndarray:
    """Return (pieces,) int64: the first piece that has the same eight vertices: around a crotch pieces that do not
    touch may share all of them, and are one body there however often it is counted."""
    same = np.arange(len(voxel))
    doubled = np.flatnonzero((np.bincount(voxel) > 1)[voxel])
    if len(doubled):
        _, first, number = np.unique(vertex[doubled], axis=0, return_index=True, return_inverse=True)
        same[doubled] = doubled[first[number.reshape(-1)]]
    return same


def _shape_functions(per_voxel: int) -> np.ndarray:
    """Return (parity, tetrahedra, 4, 4): the matrices that take (1, x, y, z), in voxels, to the weights of the four
    corners."""
    corners = np.concatenate([np.ones((*CUTS[per_voxel].shape, 1)), EIGHT[CUTS[per_voxel]]], axis=-1)
    inverse = np.linalg.inv(np.swapaxes(corners, -1, -2))
    functions: np.ndarray = np.round(2 * inverse) / 2  # whole numbers and halves
    return functions


def _weights(local: np.ndarray, parity: np.ndarray, functions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (which of the voxel's tetrahedra (points,), weights (points, 4)): of each point at `local` (points, 3)
    from its voxel's first corner, in voxels, the one that it lies in, or least outside of, by the shape `functions`
    (_shape_functions)."""
    point = np.column_stack([np.ones(len(local)), local])
    weights = applied(functions[parity], point[:, None])
    best = weights.min(axis=2).argmax(axis=1)
    return best, np.take_along_axis(weights, best[:, None, None], axis=1)[:, 0]


def _piece_of_vertices(
    hull: Solid, snapped: np.ndarray, cells: Cells, pieces: Pieces, pairs: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return (vertices,) int64: the piece that carries each vertex of the hull: the one that a triangle of it belongs
    to, in a voxel that the vertex is in or on. A vertex all of whose triangles lie on the lattice is carried by the
    voxel below them, by the piece of it that is nearest; one of a fin without thickness there, which is in no voxel, by
    the nearest, outside of it."""
    triangle, voxel = pairs
    corner, low = hull.triangles[triangle], cells.index[voxel]
    contains = ((snapped[corner] >= low[:, None]) & (snapped[corner] <= low[:, None] + 1)).all(axis=2)
    piece = np.full(len(snapped), -1, dtype=np.int64)
    for k in range(3):
        piece[corner[contains[:, k], k]] = pieces.of_pair[contains[:, k]]
    left = np.flatnonzero(piece < 0)
    if not len(left):
        return piece
    inwards = -mesh_normals(hull.position, hull.triangles)[left]
    directions = 2.0 * EIGHT - 1
    at = snapped[left, None]
    around = np.floor(np.where(at == np.round(at), at + 0.25 * directions, at)).astype(np.int64)
    number = cells.number(around.reshape(-1, 3)).reshape(-1, 8)
    best = np.where(number >= 0, dot(inwards[:, None], directions), -np.inf).argmax(axis=1)
    carrier = number[np.arange(len(left)), best]
    lost = np.flatnonzero(carrier < 0)
    if len(lost):
        from scipy.spatial import cKDTree

        carrier[lost] = cKDTree(cells.index + 0.5).query(snapped[left[lost]])[1]
    piece[left] = pieces.nearest(carrier, snapped[left] - cells.index[carrier])
    return piece
