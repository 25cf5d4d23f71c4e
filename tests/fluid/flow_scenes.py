"""Small scenes in which fluids come and go."""

from __future__ import annotations

from typing import Any

from fluid_scenes import FLOOR, METHOD, D

from softlab.model.scene.scene import Scene

TAP = {"kind": "emitter", "center": [0.1, 0.35, 0.1], "radius": 0.08, "speed": 2.4}
DRAIN = {"kind": "sink", "center": [0.35, 0.0, 0.1], "half_size": [0.1, 0.2, 0.4]}


def tap_scene(**changes: Any) -> Scene:
    """Water and oil from a disc and from a rectangle that shuts, over a little water; a box and a half-space take what comes
    near; there is less oil than is due."""
    tables: dict[str, Any] = {
        "water": {"kind": "fluid", "size": [4 * D, 2 * D, 4 * D], "rest_distance": D, "capacity": 90, "viscosity": 2.0},
        "oil": {"kind": "fluid", "rest_distance": D, "capacity": 8, "density": 700.0, "drag": 0.2},
        "tap": TAP,
        "side": {
            "kind": "emitter", "fluid": "oil", "center": [-0.2, 0.1, 0.1], "direction": [1.0, -0.5, 0.2], "speed": 2.0,
            "size": [2.2 * D, 3.1 * D], "across": [0.0, 1.0, 0.0], "start": 0.01, "stop": 0.055,
        },
        "drain": DRAIN,
        "far": {"kind": "sink", "shape": "half-space", "point": [0.0, 0.0, -0.1], "normal": [0.0, 0.0, 1.0]},
        "floor": FLOOR,
        "gravity": {},
        "method": METHOD,
    }  # fmt: skip
    return Scene(tables).replace(changes) if changes else Scene(tables)


def flat_tap() -> Scene:
    """A line over an empty basin of a plane, and a ball that takes what comes there."""
    return Scene(
        {
            "water": {"kind": "fluid", "dimensions": 2, "rest_distance": D, "capacity": 20},
            "tap": {"kind": "emitter", "center": [0.0, 0.3], "direction": [0.6, -1.0], "size": [4 * D], "speed": 2.0},
            "hole": {"kind": "sink", "shape": "sphere", "center": [0.1, 0.0], "radius": 0.12},
            "floor": FLOOR,
            "gravity": {},
            "method": METHOD,
        }
    )  # fmt: skip


FLOWS = {"tap": tap_scene, "flat tap": flat_tap}
