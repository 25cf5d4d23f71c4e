"""Small worlds with water in them."""

from __future__ import annotations

from typing import Any

from softlab.model.scene.scene import Scene

D = 0.05  # m
METHOD = {"solver": "world", "dt": 0.01, "substeps": 2, "iterations": 3}
WATER: dict[str, Any] = {
    "kind": "fluid", "size": [5 * D, 3 * D, 5 * D], "rest_distance": D, "viscosity": 10.0, "velocity": [0.2, -0.3, 0.0],
}  # fmt: skip
BRICK: dict[str, Any] = {
    "kind": "rigid_body", "shape": {"name": "box", "sides": [2 * D, D, 2 * D]}, "particle_spacing": D, "density": 600.0,
    "volume_sampling": 1.0, "surface_sampling": 0.0, "origin": [2.5 * D, 3.6 * D, 2.5 * D], "velocity": [0.0, -1.0, 0.0],
}  # fmt: skip
JELLY = BRICK | {"kind": "soft_body", "origin": [2.5 * D, 5.5 * D, 2.5 * D]}
BLOCK: dict[str, Any] = {
    "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [0.2, 0.1, 0.2], "resolution": 10}, "edge": 0.1,
    "young_modulus": 2e4, "origin": [0.1, -0.06, 0.1],
}  # fmt: skip
SHEET: dict[str, Any] = {
    "kind": "mesh", "shape": "sheet", "rows": 5, "columns": 5, "spacing": 0.06, "placement": "flat", "mass": 0.02,
    "origin": [0.0, -0.03, 0.0], "pinned": "top-corners",
}  # fmt: skip
FLOOR = {"kind": "plane", "point": [0.0, -0.15, 0.0], "thickness": 0.0}
PARTS: dict[str, dict[str, Any]] = {
    "bodies": {"brick": BRICK, "jelly": JELLY, "floor": FLOOR},
    "bodies that meet": {"brick": BRICK, "jelly": JELLY, "contact": {}},
    "tetrahedra": {"block": BLOCK},
    "cloth": {"cloth": SHEET, "structural": {"compliance": 1e-6}},
    "all": {
        "block": BLOCK, "brick": BRICK, "floor": FLOOR, "cloth": SHEET | {"origin": [0.0, 0.45, 0.0]},
        "structural": {"compliance": 1e-6}, "contact": {"distance": 0.02},
    },
}  # fmt: skip


def wet_scene(name: str, **changes: Any) -> Scene:
    """A scene of PARTS, with water."""
    tables = PARTS[name] | {"water": WATER, "gravity": {}, "method": METHOD} | changes
    return Scene({key: table for key, table in tables.items() if table is not None}, name)
