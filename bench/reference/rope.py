"""Closed form of a rope that hangs at rest: a cloth of one row, pinned at its first mass only."""

from __future__ import annotations

import numpy as np

from softlab.bench.reference import cloth
from softlab.bench.reference.steps import masses, pinned_mask
from softlab.model.base.errors import SceneError
from softlab.model.scene.scene import Scene


def hanging(scene: Scene) -> np.ndarray:
    """Return the rest positions: (particles, 3) [m].

    Straight down from the first mass, every link elongated by the weight below it over its stiffness. Raises SceneError
    for a scene that is not such a rope.
    """
    grid, springs = scene.grid, scene.cloth_springs
    alone = grid.rows == 1 and pinned_mask(scene).ravel().tolist() == [True] + [False] * (grid.columns - 1)
    if not (alone and list(springs) == ["structural"]) or scene.wind or scene.colliders:
        raise SceneError("cloth.rows", grid.rows, "must be 1, with the first mass pinned and structural springs alone")
    mass = np.broadcast_to(masses(scene), (1, grid.columns, 1)).ravel()
    below = np.cumsum(mass[::-1])[::-1]  # kg: a mass and all below it
    g = scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    position = np.tile(cloth.start(scene)[0][0], (grid.columns, 1))
    position[1:, 1] -= np.cumsum(grid.spacing + below[1:] * g / springs["structural"].stiffness)
    return position
