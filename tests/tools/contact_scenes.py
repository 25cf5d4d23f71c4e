"""Cloths that meet themselves: folded ones, and states in which many masses are near triangles."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.scene.scene import Scene

SPACING = 0.1


def folded(rows: int = 8, columns: int = 5, layer: int = 3, apart: int = 1, **parts: Any) -> Scene:
    """A strip folded zig-zag above a floor; tables given replace or join its own."""
    tables: dict[str, Any] = {
        "cloth": {
            "rows": rows,
            "columns": columns,
            "spacing": SPACING,
            "placement": "flat",
            "origin": [0.0, 0.02, 0.0],
        },
        "fold": {"rows": layer, "apart": apart},
        "structural": {"stiffness": 1000.0},
        "shear": {"stiffness": 100.0},
        "damping": {"coefficient": 0.01},
        "gravity": {},
        "perturbation": {"amplitude": 0.004},
        "floor": {"kind": "plane", "thickness": 0.01, "static_friction": 0.5, "dynamic_friction": 0.4},
        "self_collision": {"thickness": 0.06},
        "method": {"solver": "xpbd", "dt": 1 / 60, "substeps": 4, "iterations": 2},
    }
    return Scene(tables | parts, name="folded")


def crumpled(scene: Scene, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """(before, predicted) (particles, 3): half a spacing of noise on the start, so that no two features are equally near
    but for chance, and a motion of a third of one."""
    random, start = np.random.default_rng(seed), build(scene).position
    before = start + random.uniform(-0.5, 0.5, start.shape) * SPACING
    return before, before + random.uniform(-0.3, 0.3, start.shape) * SPACING
