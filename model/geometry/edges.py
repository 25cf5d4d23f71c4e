"""Topology of a triangle mesh: edges, the triangles at them and at each vertex, connected parts.

All by sorting, with no loop over triangles, so that a mesh of a million vertices takes seconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softlab.model.base.errors import InputError
from softlab.model.geometry.lists import Lists, grouped


class NonManifold(InputError):
    """An edge has more than two triangles."""


@dataclass(frozen=True)
class MeshEdges:
    """The edges of a triangle mesh, each between two vertices and beside one triangle or two.

    int32. `edges` (edges, 2): the lower vertex first, rows ascending. `triangles` (edges, 2): those beside it, the lower
    first; -1 for none. `sides` (triangles, 3): the edge from a triangle's corner k to its corner k + 1.
    `winged` (inner edges, 4): of each edge with two triangles, in the order of `edges`, its ends in the order in which the
    first triangle passes them, then the vertex opposite in the first and in the second triangle.
    `inner` (inner edges,): its index in `edges`. `alike` (inner edges,) bool: both triangles pass it the same way, so one
    of them is turned over.
    """

    vertex_count: int
    edges: np.ndarray
    triangles: np.ndarray
    sides: np.ndarray
    winged: np.ndarray
    inner: np.ndarray
    alike: np.ndarray
    corners: np.ndarray  # (triangles, 3), as given

    @property
    def boundary(self) -> np.ndarray:
        """True for edges of a single triangle, (edges,) bool."""
        return self.triangles[:, 1] < 0

    @cached_property
    def vertex_triangles(self) -> Lists:
        """Triangles of which each vertex is a corner, ascending."""
        corner = self.corners.ravel()
        return grouped(corner, np.arange(len(corner), dtype=np.int32) // 3, self.vertex_count)

    @cached_property
    def neighbours(self) -> Lists:
        """Vertices that are joined to each vertex by an edge, ascending."""
        low, high = self.edges.T  # edges ascend, so that a vertex' lower neighbours do, and its higher ones after them
        return grouped(np.concatenate([high, low]), np.concatenate([low, high]), self.vertex_count)

    def boundary_loops(self) -> int:
        """Return the number of holes and outer rims; two that share a vertex count as one."""
        rim = self.edges[self.boundary]
        label = components(self.vertex_count, rim)
        return len(np.unique(label[rim[:, 0]]))

    def parts(self) -> int:
        """Return the number of pieces that hang together by edges or vertices (vertices without a triangle are none)."""
        label = components(self.vertex_count, self.edges)
        return len(np.unique(label[self.edges[:, 0]]))


def mesh_edges(vertex_count: int, triangles: np.ndarray) -> MeshEdges:
    """Return the edges of `triangles` (n, 3), each of three different vertices 0 ... vertex_count - 1.

    Raises NonManifold for an edge of more than two triangles, where bending is undefined.
    """
    corners = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1, 3)
    start, end = corners.ravel(), corners[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    key = low.astype(np.int64) * vertex_count + high
    order = np.argsort(key, kind="stable")  # sides of one edge come together, the lower triangle's first
    key = key[order]
    new = np.concatenate([[True], key[1:] != key[:-1]])[: len(key)]
    first = np.flatnonzero(new)
    beside = np.diff(np.append(first, len(key)))
    if (beside > 2).any():
        _refuse_fins(first[beside > 2], beside, order, low, high)
    sides = np.empty(len(key), dtype=np.int32)
    sides[order] = np.cumsum(new) - 1
    inner = np.flatnonzero(beside == 2)
    one, two = order[first[inner]], order[first[inner] + 1]
    at_edge = np.full((len(first), 2), -1, dtype=np.int32)
    at_edge[:, 0] = order[first] // 3
    at_edge[inner, 1] = two // 3
    opposite = corners[:, [2, 0, 1]].ravel()
    return MeshEdges(
        vertex_count,
        np.stack([low[order[first]], high[order[first]]], axis=1),
        at_edge,
        sides.reshape(-1, 3),
        np.stack([start[one], end[one], opposite[one], opposite[two]], axis=1),
        inner.astype(np.int32),
        start[one] == start[two],
        corners,
    )


def _refuse_fins(places: np.ndarray, beside: np.ndarray, order: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    count, side = len(places), order[places[0]]
    edges = "1 edge has" if count == 1 else f"{count} edges have"
    raise NonManifold(
        f"{edges} more than two triangles (non-manifold), first the edge between vertices {low[side]} and {high[side]} "
        f"with {beside[beside > 2][0]}; a cloth needs two at most: leave the extra ones out, or split the mesh there into "
        "sheets with vertices of their own, a little apart. mesh_collider takes the file as it is; "
        "rigid_body, soft_body, tetrahedral_body and distance_field do where it is closed, or with fill_holes = true"
    )


def edge_uses(vertex_count: int, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (ends (edges, 2) int64, the lower first; (edges,) int64: how many of `triangles` (n, 3) each edge has)."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    key = np.minimum(start, end).astype(np.int64) * vertex_count + np.maximum(start, end)
    key, count = np.unique(key, return_counts=True)
    return np.stack(np.divmod(key, vertex_count), axis=1), count


def components(count: int, ends: np.ndarray) -> np.ndarray:
    """Return (count,) int64: for each of `count` nodes the lowest node that edges `ends` (n, 2) join it to."""
    from scipy.sparse import coo_array  # a tenth of a second, for those who have meshes
    from scipy.sparse.csgraph import connected_components

    one, other = np.asarray(ends, dtype=np.int32).reshape(-1, 2).T  # scipy's graphs have 32-bit indices
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    label = connected_components(graph, directed=False)[1]
    return np.unique(label, return_index=True)[1][label]
