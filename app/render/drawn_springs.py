"""A sheet as lines: its drawn springs and their strains. No OpenGL."""

from __future__ import annotations

import numpy as np

from softlab.app.presentation import presentation_of
from softlab.model.scene.scene import Scene

ALIKE = 0.01  # of a rest length: strains are drawn as true as that


def drawn_kinds(scene: Scene) -> list[str]:
    """Return the kinds of a cloth's springs that are drawn as lines. Bending springs coincide with others and are drawn
    only where there are no others."""
    kinds = list(scene.cloth_springs)
    return [kind for kind in kinds if kind != "bending"] or kinds


def drawn_lines(scene: Scene) -> list[tuple[np.ndarray, float]]:
    """Return [(ends (springs, 2), their rest length [m])]: the springs of a grid, or the drawn ones of a cloth, kind by
    kind. Edges of a mesh are grouped by rest lengths that differ by less than ALIKE; each group has its mean rest
    length."""
    return presentation_of(scene).lines(scene)


def alike(ends: np.ndarray, rest: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return `ends` (edges, 2) grouped by rest lengths (edges,) [m] that differ by less than ALIKE, each group with its
    mean."""
    number = np.floor(np.log(rest / rest.min()) / np.log1p(ALIKE)).astype(int) if len(rest) else rest
    return [(ends[number == n], float(rest[number == n].mean())) for n in np.unique(number)]


def drawn_strain(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Return the strain (springs,) float64, (length - rest) / rest, of the springs that are drawn, of a grid or a
    cloth; (0,) without springs.

    For bodies (entries,): distances of particles from their goals, in spacings. For a world: its members one after the
    other.
    """
    return presentation_of(scene).strain(scene, position)
