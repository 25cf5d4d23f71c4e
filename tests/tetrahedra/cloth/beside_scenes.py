"""Tetrahedral bodies and a cloth in one scene: small ones, for the tests of every backend."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

SIDE, SPACING = 0.1, 0.05  # m, of the box and of the cloth
METHOD: dict[str, Any] = {"solver": "xpbd", "dt": 0.01, "substeps": 2, "iterations": 2}
BOX: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [SIDE] * 3}, "edge": 0.05, "young_modulus": 1e5,
    "damping": 0.01,
}  # fmt: skip


def sheet(rows: int = 5, columns: int = 5, **fields: Any) -> dict[str, Any]:
    """A cloth that lies in y = 0, from the origin to +x and +z."""
    made = {
        "kind": "mesh", "shape": "sheet", "rows": rows, "columns": columns, "spacing": SPACING, "placement": "flat",
        "density": 0.5, "pinned": "edges",
    }  # fmt: skip
    return made | fields


CLOTH: dict[str, Any] = {
    "cloth": sheet(), "structural": {"stiffness": 400.0, "damping": 1e-3},
    "bending": {"model": "isometric", "stiffness": 1e-4},
}  # fmt: skip
TIE: dict[str, Any] = {"kind": "attachment", "body": "cloth", "vertices": "left", "to": "box"}
HOOK: dict[str, Any] = {"kind": "attachment", "body": "foot", "vertices": "top", "to": "cloth", "compliance": 1e-4}


def on_cloth(**parts: Any) -> Scene:
    """A box over the middle of a cloth, a little less than the distance that they keep, with such parts; those that are None
    left out."""
    box = BOX | {"origin": [0.1, 0.055, 0.11]}
    tables: dict[str, Any] = {
        "box": box,
        **CLOTH,
        "contact": {"distance": 0.01, "sweeps": 2},
        "gravity": {},
        "method": METHOD,
    }
    return Scene({name: table for name, table in (tables | parts).items() if table is not None}, "on cloth")


def tied(**parts: Any) -> Scene:
    """A cloth that hangs by its left side on the right side of a box, a foot hung on it by its top, and a cube that comes up
    to it from below between them, in a wind."""
    small = {"shape": {"name": "box", "sides": [0.05] * 3}, "velocity": [0.0, 0.5, 0.0]}
    large = {"shape": {"name": "box", "sides": [SIDE, SIDE, 0.3]}, "pinned": ["left"]}
    bodies = {
        "box": BOX | large | {"origin": [-SIDE / 2, 0.0, 0.1]},
        "foot": BOX | {"origin": [0.29, -SIDE / 2, 0.11], "material": "neo-hookean"},
        "cube": BOX | small | {"origin": [0.12, -0.033, 0.11]},
    }  # fmt: skip
    wind = {"velocity": [1.0, 0.5, 3.0], "drag": 1.2, "lift": 0.8}
    return on_cloth(**bodies | {"wind": wind} | {"cloth": sheet(5, 8, pinned="none"), "tie": TIE, "hook": HOOK} | parts)


def crumpled_state(scene: Scene, seed: int = 1) -> State:
    """Its beginning, out of shape, so that no two features are equally near, and moving."""
    random, body = np.random.default_rng(seed), build(scene)
    free = (body.inverse_mass > 0)[:, None]
    position = body.position + free * random.uniform(-0.004, 0.004, body.position.shape)
    velocity = body.velocity + free * random.uniform(-0.3, 0.3, body.position.shape)
    return State(position, velocity, body.inverse_mass, 0.0, 0)
