"""Small worlds: a jelly of clusters, a block of tetrahedra and a cloth, which meet."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "world", "dt": 0.01, "substeps": 3, "iterations": 2}
BLOCK: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.3, 0.1, 0.3], "resolution": 10}, "edge": 0.1,
    "young_modulus": 2e4, "poisson_ratio": 0.35,
}  # fmt: skip
JELLY: dict[str, Any] = {
    "kind": "soft_body", "shape": {"name": "box", "sides": [0.15, 0.15, 0.15]}, "particle_spacing": 0.05,
    "origin": [0.01, 0.15, 0.02], "velocity": [0.3, -1.0, 0.1],
}  # fmt: skip
BALL: dict[str, Any] = {
    "kind": "rigid_body", "shape": {"name": "box", "sides": [0.1, 0.05, 0.1]}, "particle_spacing": 0.05,
    "origin": [0.0, 0.28, 0.0], "velocity": [0.0, -2.0, 0.0], "spin": [1.0, 2.0, 0.0],
}  # fmt: skip
SHEET: dict[str, Any] = {
    "kind": "mesh", "shape": "sheet", "rows": 6, "columns": 6, "spacing": 0.06, "placement": "flat", "mass": 0.005,
    "origin": [-0.15, 0.06, -0.15], "pinned": "top-corners",
}  # fmt: skip
CLOTH: dict[str, Any] = {"cloth": SHEET, "structural": {"compliance": 1e-6}, "bending": {"model": "isometric"}}
CONTACT = {"sweeps": 2, "distance": 0.02}
FLOOR: dict[str, Any] = {"kind": "plane", "point": [0.0, -0.06, 0.0], "static_friction": 0.4, "dynamic_friction": 0.3}
PARTS: dict[str, dict[str, Any]] = {
    "jelly on a block": {"block": BLOCK, "jelly": JELLY},
    "two on a pinned block": {"block": BLOCK | {"pinned": ["bottom"]}, "jelly": JELLY, "brick": BALL},
    "jelly on a cloth": {"jelly": JELLY} | CLOTH,
    "jelly on a block by vertices": {"block": BLOCK | {"damping": 0.01}, "jelly": JELLY},
    "all": {"block": BLOCK, "jelly": JELLY, "brick": BALL, "floor": FLOOR} | CLOTH,
}


BY_VERTICES = (
    "jelly on a block by vertices"  # whose tetrahedra vertex block descent solves, which no judge of worlds knows
)


def world_scene(name: str, **changes: Any) -> Scene:
    """A scene of PARTS."""
    method = METHOD | ({"tetrahedra": "vbd"} if name == BY_VERTICES else {})
    tables = PARTS[name] | {"gravity": {}, "contact": CONTACT, "method": method} | changes
    return Scene({key: table for key, table in tables.items() if table is not None}, name)


def moving(scene: Scene, apart: float = 0.002) -> State:
    """Its beginning, out of shape and moving: differently at every particle."""
    body, random = build(scene), np.random.default_rng(3)
    free = (body.inverse_mass > 0)[:, None]
    position = body.position + free * random.normal(0, apart, body.position.shape)
    velocity = body.velocity + free * random.normal(0, 0.05, body.velocity.shape)
    return State(position, velocity, body.inverse_mass, 0.0, 0)
