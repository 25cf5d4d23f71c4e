"""Tetrahedral bodies that never meet, in shares: pokes, what couples them (bits: test_shares.py)."""

from __future__ import annotations

from typing import Any

from softlab.model.scene.scene import Scene

BOX = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]},
    "edge": 0.1,
    "young_modulus": 1e4,
}
FALLS = {"velocity": [0.2, -2.0, 0.0], "spin": [1.0, 2.0, 3.0]}
BODIES: dict[str, dict[str, Any]] = {  # of every material, order of sweeps and kind of damping
    "turned": BOX | {"pinned": ["left"]},
    "hookean": BOX | FALLS | {"material": "neo-hookean", "damping": 0.01},
    "held": BOX | FALLS | {"mass_damping": 2.0},
    "single": BOX | FALLS | {"sweep": "tetrahedra", "young_modulus": 2e4},
    "six": BOX | FALLS | {"tetrahedra": 6, "material": "corotated"},
    "wholes": BOX | FALLS | {"volume": "voxels", "poisson_ratio": 0.49},
    "alone": BOX | FALLS | {"sweep": "tetrahedra", "density": 500.0},
}  # fmt: skip
METHOD = {"solver": "xpbd", "dt": 0.01, "substeps": 2, "iterations": 2}


def scene_of(*names: str, **more: Any) -> Scene:
    """Those bodies, just above the ground; one is turned at its end, one goes with a ball that it is held by."""
    parts = {name: BODIES[name] | {"origin": [n, 0.11, 0.0]} for n, name in enumerate(names or BODIES)}
    turn = {"kind": "motion", "pins": "left", "body": "turned", "angular_velocity": 5.0, "axis": [1.0, 0.0, 0.0]}
    ground = {"kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0], "static_friction": 0.4}
    ball = {"kind": "sphere", "center": [2.0, 1.0, 0.0], "radius": 0.2, "velocity": [0.0, 0.5, 0.0]}
    grip = {"kind": "attachment", "body": "held", "vertices": "right", "to": "ball"}
    moved: dict[str, Any] = {"turn": turn} if "turned" in parts else {}
    moved |= {"ball": ball, "grip": grip} if "held" in parts else {}
    return Scene({**parts, **moved, "ground": ground, "gravity": {}, "method": METHOD, **more})
