"""Small scenes of fluids that, among them, have every part."""

from __future__ import annotations

from typing import Any

import numpy as np

from softlab.model.core.build import build
from softlab.model.core.state import State
from softlab.model.scene.scene import Scene

METHOD = {"solver": "pbf", "dt": 1 / 60, "substeps": 2, "iterations": 3}
FLOOR = {"kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}
WALL = {
    "kind": "plane",
    "point": [0.0, 0.0, 0.0],
    "normal": [0.8, 0.6, 0.0],
    "static_friction": 0.4,
    "dynamic_friction": 0.3,
    "restitution": 0.4,
}


def few(size: tuple[float, ...] = (0.15, 0.2, 0.15), **method: Any) -> Scene:
    """A block that falls onto the floor and meets a wall."""
    water = {"kind": "fluid", "size": list(size), "rest_distance": 0.05, "velocity": [-0.3, 0.0, 0.1]}
    return Scene({"water": water, "gravity": {}, "floor": FLOOR, "wall": WALL, "method": METHOD | method}, "few")


def rich() -> Scene:
    """Two fluids with all that one may have, between a moving ball, a rod and a block."""
    both = {"kind": "fluid", "rest_distance": 0.05, "viscosity": 2.0, "cohesion": 0.5, "surface_tension": 0.3}
    water = both | {
        "size": [0.1, 0.15, 0.15], "origin": [0.0, 0.03, 0.0], "vorticity_confinement": 0.02, "drag": 0.2, "buoyancy": 0.9,
        "maximum_acceleration": 40.0,
    }  # fmt: skip
    oil = both | {
        "size": [0.1, 0.1, 0.1], "origin": [0.1, 0.05, 0.02], "density": 600.0, "viscosity": 5.0, "free_surface_drag": 2.0,
        "velocity": [-1.0, 0.3, 0.2], "maximum_speed": 1.1,
    }  # fmt: skip
    ball = {"kind": "sphere", "center": [0.3, 0.1, 0.1], "radius": 0.1, "velocity": [-2.0, 0.0, 0.0]}
    rod = {"kind": "capsule", "start": [-0.1, 0.05, -0.2], "end": [-0.08, 0.1, 0.3], "radius": 0.08}
    block = {
        "kind": "box",
        "center": [0.1, -0.05, 0.1],
        "half_size": [0.5, 0.05, 0.5],
        "static_friction": 0.4,
        "dynamic_friction": 0.3,
    }
    return Scene(
        {
            "water": water, "oil": oil, "gravity": {}, "ball": ball, "rod": rod, "block": block,
            "method": METHOD | {"tensile_correction": 0.001},
        },
        "rich",
    )  # fmt: skip


def flat(**method: Any) -> Scene:
    """A drop in the plane, in a box whose left and right sides are one."""
    water = {
        "kind": "fluid", "dimensions": 2, "size": [0.2, 0.25], "rest_distance": 0.05, "velocity": [1.5, 0.0, 0.0],
        "viscosity": 1.0, "vorticity_confinement": 0.01,
    }  # fmt: skip
    domain = {"origin": [0.0, 0.0], "size": [0.4, 1.0], "repeats": ["x"]}
    return Scene({"water": water, "domain": domain, "gravity": {}, "floor": FLOOR, "method": METHOD | method}, "flat")


def free(scene: Scene) -> Scene:
    """The same by velocities that keep density and have no divergence."""
    return scene.replace({"method.scheme": "divergence-free", "method.tensile_correction": 0.0})


def stirred(scene: Scene, seed: int = 1) -> State:
    """Its start, particles moved by a tenth of their distance, and in places swapped, as nothing is when it has run; two of
    them in one place."""
    body, random = build(scene), np.random.default_rng(seed)
    position = body.position + random.normal(0, 0.1 * scene.fluid_set.spacing, body.position.shape)
    velocity = body.velocity + random.normal(0, 0.2, body.velocity.shape)
    position[3], velocity[3] = position[7], velocity[7]
    return State(position, velocity, body.inverse_mass, 0.0, 0)
