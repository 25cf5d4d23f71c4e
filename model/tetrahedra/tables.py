"""Lists of tetrahedral bodies for both backends, in addition to their constraints."""

from __future__ import annotations

import numpy as np

from softlab.model.particles.tetrahedra_set import TetrahedraSet


def surface_lists(body_set: TetrahedraSet, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return int32 (offsets (particles + 1,), triangles at each particle, ascending, corners (triangles, 3)) of the
    surface; empty ones if not `wanted`."""
    if not wanted:
        return np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros((1, 3), np.int32)
    lists = body_set.vertex_triangles
    return lists.offsets, lists.indices, body_set.surface


def cloth_lists(body_set: TetrahedraSet, wanted: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lists of the cloth alone, on which wind acts; empty ones if there is none, or if not `wanted`."""
    if body_set.sheet is None or not wanted:
        return surface_lists(body_set, False)
    start = int(body_set.first_particle[-1])
    lists = body_set.sheet.mesh.edges.vertex_triangles
    offsets = np.concatenate([np.zeros(start, np.int32), lists.offsets])
    return offsets, lists.indices, (body_set.sheet.mesh.triangles + start).astype(np.int32)
