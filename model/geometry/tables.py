"""Lists of a mesh that both backends read besides its constraints: the triangles at each vertex, long-range attachments."""

from __future__ import annotations

import numpy as np

from softlab.model.geometry.mesh import TriangleMesh


def wind_lists(mesh: TriangleMesh, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return int32 arrays (offsets (vertices + 1,), triangles at each vertex, ascending, corners (triangles, 3)); empty
    ones if not `wanted`."""
    if not wanted:
        return np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 3), np.int32)
    lists = mesh.edges.vertex_triangles
    return lists.offsets, lists.indices, mesh.triangles
