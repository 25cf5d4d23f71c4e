"""Lists of tetrahedral bodies for both backends, in addition to their constraints."""

from __future__ import annotations

import numpy as np

from softlab.model.particles.tetrahedra_set import TetrahedraSet


def surface_lists(found: TetrahedraSet, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return int32 (offsets (particles + 1,), triangles at each particle, ascending, corners (triangles, 3)) of the
    surface; empty ones if not `wanted`."""
    if not wanted:
        return np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 3), np.int32)
    lists = found.vertex_triangles
    return lists.offsets, lists.indices, found.surface


def cloth_lists(found: TetrahedraSet, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lists of the cloth alone, on which wind acts; empty ones if there is none, or not `wanted`."""
    if found.sheet is None or not wanted:
        return surface_lists(found, False)
    start = int(found.first_particle[-1])
    lists = found.sheet.mesh.edges.vertex_triangles
    offsets = np.concatenate([np.zeros(start, np.int32), lists.offsets])
    return offsets, lists.indices, (found.sheet.mesh.triangles + start).astype(np.int32)
