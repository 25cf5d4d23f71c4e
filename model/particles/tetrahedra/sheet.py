"""A cloth of triangles in a scene of tetrahedral bodies: its vertices come after their particles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softlab.model.base.errors import naming
from softlab.model.base.pins import pin_indices
from softlab.model.geometry.mesh import TriangleMesh
from softlab.model.geometry.topology import mesh_of, pinned_vertices, vertex_masses
from softlab.model.tables.mesh import Mesh
from softlab.model.tables.regions import Region
from softlab.model.tables.selection import vertices_of


@dataclass(frozen=True, eq=False)
class Sheet:
    """The cloth's name in the scene, its part and mesh; `position` (vertices, 3) float64 [m]: rest positions in the
    scene; `masses` (vertices,) [kg]; `pinned` (pins,) int64, ascending; all numbered from 0."""

    name: str
    part: Mesh
    mesh: TriangleMesh
    position: np.ndarray
    masses: np.ndarray
    pinned: np.ndarray


def sheet_of(name: str, part: Mesh, attached: Sequence[str], regions: Mapping[str, Region]) -> Sheet:
    """Return the cloth; `attached`: words for vertices that attachments pin. Raises SceneError, InputError."""
    mesh = mesh_of(part)
    position = mesh.position + part.origin
    by_rows = part.file is None
    stated = pin_indices(part.pinned, part.rows, part.columns) if by_rows else pinned_vertices(part)
    with naming(name):
        more = [vertices_of(word, mesh.position, position, regions) for word in attached]
    pinned = np.unique(np.concatenate([stated, *more])).astype(np.int64)
    return Sheet(name, part, mesh, position, vertex_masses(part), pinned)
