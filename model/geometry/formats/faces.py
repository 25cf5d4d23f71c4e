"""The unrepaired content of a mesh file: vertices, polygons, and their line numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def _nowhere(_number: int) -> str:
    return ""


@dataclass(frozen=True, eq=False)
class Faces:
    """Vertices and polygons of a file.

    `position` (vertices, 3) float64, in the file's unit; `corners` (sum of sizes,) int64: vertices of one polygon after the
    other, counted from 0; `sizes` (faces,) int64: corners of each. `vertex_line`, `face_line`: return `line N` of a vertex or
    a face, empty for a binary file. `first`: the number of the first vertex in the file's own counting. `notes`: a sentence
    for each thing that the reader decided.
    """

    position: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    vertex_line: Callable[[int], str] = _nowhere
    face_line: Callable[[int], str] = _nowhere
    first: int = 0
    notes: tuple[str, ...] = ()


def uniform(position: np.ndarray, faces: np.ndarray, notes: tuple[str, ...] = ()) -> Faces:
    """Return the content of a file whose faces (n, k) all have k corners."""
    faces = np.asarray(faces, dtype=np.int64)
    sizes = np.full(len(faces), faces.shape[1] if faces.ndim == 2 else 3, dtype=np.int64)
    return Faces(np.asarray(position, dtype=np.float64).reshape(-1, 3), faces.ravel(), sizes, notes=notes)
