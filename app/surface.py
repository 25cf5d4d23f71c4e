"""A cloth as something to draw: its triangles and springs, and how far those are stretched. No OpenGL."""

from __future__ import annotations

import numpy as np

from model.cloth_record import REACH
from model.energy import spring_strain
from model.scene import Scene


def triangles(rows: int, columns: int) -> np.ndarray:
    """(2 (rows - 1) (columns - 1), 3) uint32: two triangles a cell, split from its first mass to the one opposite.

    Counter-clockwise from where a hanging cloth is seen from +z, a flat one from above.
    """
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.ascontiguousarray(np.stack([a, c, d, a, d, b], axis=-1).reshape(-1, 3))


def drawn_kinds(scene: Scene) -> list[str]:
    """The kinds of a cloth's springs that are drawn as lines: bending ones lie on top of others, where there are others."""
    kinds = list(scene.cloth_springs)
    return [kind for kind in kinds if kind != "bending"] or kinds


def rest_length(scene: Scene, kind: str) -> float:
    """Of a cloth's springs of a `kind` [m]."""
    return REACH[kind] * scene.grid.spacing


def drawn_strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    """(springs,) float64: (length - rest) / rest of the springs that are drawn, of a grid or a cloth; (0,) without."""
    if not scene.cloth:
        return spring_strain(scene, position) if scene.springs else np.zeros(0)
    with np.errstate(over="ignore", invalid="ignore"):
        strains = [spring_strain(scene, position, kind) for kind in drawn_kinds(scene)]
    return np.concatenate([np.zeros(0), *strains])
