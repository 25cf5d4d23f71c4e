"""Lists of tetrahedral bodies that both backends read besides their constraints."""

from __future__ import annotations

import numpy as np

from model.tetrahedra.body_set import TetrahedraSet


def surface_lists(found: TetrahedraSet, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """int32 (offsets (particles + 1,), triangles at each particle, ascending, corners (triangles, 3)) of the surface; nothing
    if not `wanted`."""
    if not wanted:
        return np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 3), np.int32)
    lists = found.vertex_triangles
    return lists.offsets, lists.indices, found.surface
