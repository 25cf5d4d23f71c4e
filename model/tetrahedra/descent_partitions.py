"""Vertices that a substep of vertex block descent reads: see model/tetrahedra/partitions.py."""

from __future__ import annotations

import numpy as np

from softlab.model.core.sharing.partitions import Window
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.descent import descents


def descended(scene: Scene, needed: np.ndarray) -> Window:
    """Return the window that all sweeps of a substep read so that the `needed` (particles,) bool are as in the whole."""
    body_set, needed = scene.tetrahedra_set, needed.copy()
    for _ in range(scene.method.iterations):
        before = needed.sum()
        for one in reversed(descents(scene)):
            for colour in reversed(range(one.colours)):
                visited = np.zeros(len(needed), bool)
                vertices = one.order[one.starts[colour] : one.starts[colour + 1]]
                visited[vertices] = needed[vertices]
                needed[one.corners[visited[one.corners].any(axis=1)]] = True
        if needed.sum() == before:
            break
    return np.flatnonzero(needed), np.flatnonzero(needed[body_set.tetrahedra].all(axis=1))
