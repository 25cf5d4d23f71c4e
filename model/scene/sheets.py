"""A run's lines on a scene's sheet: its mesh, and its springs at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from softlab.model.geometry.colouring import RINGS
from softlab.model.geometry.topology import mesh_of, pinned_vertices
from softlab.model.scene.scene import Scene

FEW_PINS = 3  # a cloth held at fewer vertices swings about them
MANY_EDGES = 256  # at a vertex: each costs a barrier of threads or a launch per sweep


def mesh_lines(scene: Scene) -> list[str]:
    """Return the lines on a mesh from a file: sizes, and all repairs."""
    part = scene.mesh
    if part is None or part.file is None:
        return []
    mesh = mesh_of(part)
    lines = mesh.lines()
    if part.pinned == "top":
        pins = len(pinned_vertices(part))
        hangs = "; list vertices to pin more" if pins < FEW_PINS else ""
        lines.append(f'pinned = "top" holds {pins} of {len(mesh.position)} vertices, the highest{hangs}')
    meeting = np.bincount(mesh.edges.edges.ravel())
    if meeting.max() > MANY_EDGES:
        hub = int(meeting.argmax())
        x, y, z = (f"{coordinate:.4g}" for coordinate in mesh.position[hub])
        lines.append(
            f"{meeting[hub]} edges meet at vertex {hub} (counted from 0, at ({x}, {y}, {z})): they are projected one after "
            f"another, which is slow on a GPU and on several threads; {RINGS}"
        )
    return [f"{Path(part.file).name}: {line}" for line in lines]


def rest_lines(scene: Scene) -> list[str]:
    """Return a line on a grid whose springs start far from their rest length, or from a rest length that the scene does
    not state."""
    springs = scene.springs
    if springs is None:
        return []
    spacing = scene.grid.spacing
    if springs.rest_length in (0, spacing):
        return []
    if "rest_length" in springs.model_fields_set and 0.5 <= spacing / springs.rest_length <= 2:
        return []
    return [
        f"springs begin at {spacing / springs.rest_length:.3g} of their rest length (grid.spacing = {spacing:g} m, "
        f"springs.rest_length = {springs.rest_length:g} m)"
    ]
