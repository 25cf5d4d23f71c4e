"""Lists of long-range attachments, which both backends read in addition to the constraints."""

from __future__ import annotations

import numpy as np

from softlab.model.base.types import Real
from softlab.model.core.build import Body, rest_positions
from softlab.model.geometry.geodesic import mesh_attachments, sheet_attachments
from softlab.model.geometry.topology import mesh_of
from softlab.model.scene.scene import Scene

UNREACHED = 1e18  # m: the length of an attachment to nothing; its square is a number in float32


def sheet_reaches(scene: Scene, body: Body, real: Real) -> tuple[np.ndarray, np.ndarray]:
    """Return the anchors of a sheet of rows and columns and the largest distances from them.

    Returns (anchors (masses, count) int32, distances (masses, count) [m]); a mass without that many repeats the
    nearest. The path through a sheet of springs is as long as their rest lengths add up to, not as the sheet begins;
    but compliant springs that begin stretched may be held so by pins, and keep their initial length.
    """
    part, springs, spacing = scene.attachments, scene.springs, scene.grid.spacing
    assert part is not None
    anchor, distance = sheet_attachments(rest_positions(scene.grid), body.pinned, part.anchors)
    anchor, distance = np.where(anchor < 0, anchor[:, :1], anchor), np.where(anchor < 0, distance[:, :1], distance)
    scale = springs.rest_length / spacing if springs else 1.0
    if springs and not springs.inextensible:
        scale = max(scale, 1.0)
    return anchor.astype(np.int32), (distance * scale * (1 + part.slack)).astype(real)


def vertex_attachments(scene: Scene, body: Body, real: Real, wanted: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return (anchors (vertices, count) int32, how far from them (vertices, count) [m]); a vertex without that many
    repeats the nearest, one that no pinned vertex is connected with is its own anchor, with UNREACHED."""
    part, attachments = scene.mesh, scene.attachments
    if part is None or attachments is None or not wanted:
        return np.zeros((1, 1), np.int32), np.zeros((1, 1), real)
    mesh = mesh_of(part)
    anchor, far = mesh_attachments(mesh.position, mesh.edges, body.pinned, attachments.anchors)
    missing = anchor < 0
    anchor, far = np.where(missing, anchor[:, :1], anchor), np.where(missing, far[:, :1], far)
    alone = anchor < 0
    anchor = np.where(alone, np.arange(len(anchor))[:, None], anchor)
    longest = np.where(alone, UNREACHED, far * (1 + attachments.slack))
    return np.ascontiguousarray(anchor, dtype=np.int32), np.ascontiguousarray(longest, dtype=real)
