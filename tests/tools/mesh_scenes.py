"""Small scenes of meshes with every part that there is, for the tests of the kernels."""

from __future__ import annotations

from typing import Any

import numpy as np
from cloth_scenes import AIR, BODIES

from softlab.model.core.build import build
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "xpbd", "dt": 0.004, "substeps": 2, "iterations": 2}
SHEET: dict[str, Any] = {
    "mesh": {"shape": "sheet", "rows": 5, "columns": 4, "spacing": 0.1, "density": 0.3, "pinned": [[0, 0], [3, 2]]},
    "structural": {"stiffness": 100.0},
    "bending": {"stiffness": 0.02, "model": "isometric"},
    "damping": {"coefficient": 0.01},
    "gravity": {},
    "perturbation": {"amplitude": 0.008},
    "method": METHOD,
}
ALTERNATING = {"mesh": SHEET["mesh"] | {"diagonals": "alternating"}}
DIHEDRAL = {"bending": {"stiffness": 0.02, "model": "dihedral"}}
RIGID = {"structural": {"compliance": 0.0}, "bending": {"compliance": 0.0, "model": "isometric"}}
BALL = SHEET | DIHEDRAL | {"mesh": {"file": "ball.obj", "density": 0.3, "pinned": [3]}, "volume": {"stiffness": 2e3}}
PARTS: dict[str, dict[str, Any]] = {
    "isometric": SHEET,
    "dihedral": SHEET | ALTERNATING | DIHEDRAL,
    "distances": SHEET | ALTERNATING | {"bending": {"stiffness": 5.0, "damping": 0.01}}
    | {"structural": {"stiffness": 100.0, "damping": 0.02}},
    "rigid": SHEET | RIGID,
    "rigid dihedral": SHEET | RIGID | {"bending": {"compliance": 0.0, "model": "dihedral"}},
    "everything": SHEET | ALTERNATING | AIR | BODIES,
    "pbd": SHEET | DIHEDRAL | {"method": METHOD | {"solver": "pbd", "pbd_stiffness": 0.7}},
    "volume": BALL,
    "bare": {"mesh": {"shape": "sheet", "rows": 3, "columns": 3, "spacing": 0.1}, "gravity": {}, "method": METHOD},
}  # fmt: skip
HELD = PARTS["everything"] | {"attachments": {"anchors": 2, "slack": 0.001}}
POKE = (7, (0.05, -0.02, 0.1))  # particle, N


def mesh_scene(name: str, **changes: Any) -> Scene:
    """A scene of PARTS, or with long-range attachments too (`held`)."""
    return Scene((HELD if name == "held" else PARTS[name]) | changes, "mesh")


def moving(scene: Scene) -> State:
    """Its own beginning, moving: differently at every vertex."""
    body = build(scene)
    velocity = np.random.default_rng(3).normal(0, 0.1, body.position.shape)
    velocity[body.pinned] = 0
    return State(body.position, velocity, body.inverse_mass, 0.0, 0)
