"""Small scenes in which cloths of all solvers, and a body, fall on a distance field that moves and turns."""

from __future__ import annotations

from typing import Any

from bodies_scenes import BAR, bodies_scene, method
from cloth_solve import cloth
from mesh_scenes import METHOD

from softlab.model.scene.scene import Scene
from softlab.model.tables.colliders.distance_field import DistanceField

BLOCK: dict[str, Any] = {"name": "box", "resolution": 1}  # a cube of a metre
TORUS: dict[str, Any] = {"name": "torus", "resolution": 8}
CARRIER: dict[str, Any] = {
    "shape": TORUS, "spacing": 0.06, "angle": 15.0, "axis": [1.0, 0.0, 0.3], "velocity": [0.1, 1.0, 0.0],
    "spin": [0.2, 0.9, -0.3], "thickness": 0.03, "static_friction": 0.4, "dynamic_friction": 0.3,
}  # fmt: skip
SHEET = {"sheet": {"placement": "flat", "origin": (-0.3, 0.2, -0.3)}, "structural": {"stiffness": 5.0}, "gravity": {}}
CLOTHS: dict[str, Any] = {
    "semi-implicit-euler": {"integrator": "semi-implicit-euler", "dt": 0.01},
    "velocity-verlet": {"integrator": "velocity-verlet", "dt": 0.01},
    "rk4": {"integrator": "rk4", "dt": 0.01},
    "implicit-euler": {"integrator": "implicit-euler", "dt": 0.01},
    "xpbd": METHOD,
}


def block(**more: Any) -> DistanceField:
    return DistanceField(**{"shape": BLOCK, "spacing": 0.125, **more})


def falling_cloth(name: str, **more: Any) -> Scene:
    return cloth(6, 7, **SHEET, distance_field=CARRIER | more, method=CLOTHS[name])


def falling_mesh(**more: Any) -> Scene:
    mesh = {"shape": "sheet", "rows": 6, "columns": 7, "spacing": 0.1, "density": 0.3, "placement": "flat"}
    table = {"mesh": mesh | {"origin": (-0.3, 0.2, -0.3)}, "structural": {"stiffness": 100.0}, "gravity": {}}
    return Scene(table | {"distance_field": CARRIER | more, "method": METHOD}, "mesh")


def falling_bar(**more: Any) -> Scene:
    bar = BAR | {"velocity": [1.0, -6.0, 0.5], "origin": [-0.2, 0.4, 0.0]}
    return bodies_scene(bar=bar, method=method(2, 1), distance_field=CARRIER | more)


FALLING = {name: (lambda name=name, **more: falling_cloth(name, **more)) for name in CLOTHS} | {
    "mesh": falling_mesh, "bar": falling_bar,
}  # fmt: skip
