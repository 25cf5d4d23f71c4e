"""Tetrahedral bodies that meet: boxes of a few voxels."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

EDGE, SIDE = 0.1, 0.3  # m
METHOD: dict[str, Any] = {"solver": "xpbd", "dt": 1 / 60, "substeps": 20}
FLOOR: dict[str, Any] = {"kind": "plane", "point": [0.0, 0.0, 0.0], "static_friction": 0.6, "dynamic_friction": 0.5}


def box(sides: tuple[float, ...] = (SIDE, SIDE, SIDE), edge: float = EDGE, **fields: Any) -> dict[str, Any]:
    """A body of voxels, of rubber unless told."""
    shape = {"name": "box", "sides": list(sides), "resolution": 10}
    made = {"kind": "tetrahedral_body", "shape": shape, "edge": edge, "young_modulus": 1e5, "damping": 0.01}
    return made | fields


def meeting(**parts: Any) -> Scene:
    """A scene of parts, with contacts."""
    return Scene({"contact": {}, "method": METHOD} | parts, "meeting")


def three(**contact: Any) -> Scene:
    """Of three materials, one turned, one with many small triangles, one that meets itself; they overlap a little."""
    return meeting(
        first=box((0.2, 0.1, 0.1), origin=[0.0, 0.0, 0.0], damping=0.0),
        second=box(
            (0.1, 0.1, 0.1),
            0.05,
            origin=[0.03, 0.104, 0.02],
            angle=20.0,
            material="neo-hookean",
            velocity=[0.0, -1.0, 0.3],
        ),
        third=box((0.1, 0.2, 0.1), origin=[0.155, 0.04, 0.01], material="corotated", self_collision=True),
        contact={"sweeps": 2, "distance": 0.02} | contact,
        gravity={},
        method={"solver": "xpbd", "dt": 0.01, "substeps": 2, "iterations": 2},
    )


def crumpled(scene: Scene, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """(before, predicted) (particles, 3): noise on the start, so that no two features are equally near, and a motion."""
    random, start = np.random.default_rng(seed), build(scene).position
    before = start + random.uniform(-0.1, 0.1, start.shape) * EDGE
    return before, before + random.uniform(-0.05, 0.05, start.shape) * EDGE


def crumpled_state(scene: Scene) -> State:
    """Its beginning, out of shape and moving."""
    body, (before, predicted) = build(scene), crumpled(scene)
    return State(before, (predicted - before) / scene.method.dt, body.inverse_mass, 0.0, 0)
