"""Small scenes of fluids that together have every part, and where they start: a little off their lattice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from softlab.app.driver import open_simulation
from softlab.model.core.build import build
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

D = 0.05  # m
METHOD = {"solver": "pbf", "dt": 1 / 60, "substeps": 2, "iterations": 3}
FLOOR = {"kind": "plane", "thickness": 0.0}


def column_scene(**changes: Any) -> Scene:
    """A short column between sides that repeat."""
    tables = {
        "water": {"kind": "fluid", "size": [6 * D, 4 * D, 6 * D], "rest_distance": D, "viscosity": 9.0},
        "domain": {"size": [6 * D, 1.0, 6 * D]},
        "floor": FLOOR,
        "gravity": {},
        "method": METHOD,
    }
    return Scene(tables).replace(changes) if changes else Scene(tables)


def two_fluids() -> Scene:
    """Of several densities, among walls of every kind, one of which comes on."""
    return Scene(
        {
            "water": {"kind": "fluid", "size": [0.2, 0.15, 0.15], "viscosity": 9.0, "maximum_acceleration": 5.0},
            "oil": {
                "kind": "fluid", "origin": [0.0, 0.15, 0.0], "size": [0.2, 0.1, 0.15], "density": 700.0, "viscosity": 3.0,
                "cohesion": 5.0, "surface_tension": 2.0,
            },
            "floor": FLOOR,
            "side": {"kind": "plane", "normal": [1.0, 0.0, 0.0], "velocity": [0.2, 0.0, 0.0]},
            "ball": {"kind": "sphere", "center": [0.2, 0.4, 0.1], "radius": 0.1, "velocity": [0.0, -1.0, 0.0]},
            "block": {"kind": "box", "center": [0.1, -0.1, 0.3], "half_size": [0.3, 0.3, 0.1]},
            "bar": {
                "kind": "capsule", "start": [0.3, 0.0, 0.0], "end": [0.3, 0.3, 0.1], "static_friction": 0.3,
                "dynamic_friction": 0.2, "restitution": 0.4,
            },
            "gravity": {},
            "method": METHOD,
        }
    )  # fmt: skip


def flat() -> Scene:
    """Of two dimensions, in a box that repeats both ways."""
    return Scene(
        {
            "water": {
                "kind": "fluid", "dimensions": 2, "size": [0.3, 0.3], "viscosity": 5.0, "vorticity_confinement": 1.0,
                "velocity": [1.0, 0.3, 0.0], "drag": 0.3, "free_surface_drag": 3.0, "vortices": 0.2, "buoyancy": -0.5,
            },
            "domain": {"size": [0.3, 0.3], "repeats": ["x", "y"]},
            "gravity": {},
            "method": METHOD,
        }
    )  # fmt: skip


def averaged() -> Scene:
    """By the scheme of the particle libraries, with particles kept apart."""
    return Scene(
        {
            "water": {
                "kind": "fluid", "size": [0.2, 0.2, 0.15], "vorticity_confinement": 0.7, "surface_tension": 0.5,
                "maximum_speed": 0.5,
            },
            "floor": FLOOR,
            "gravity": {},
            "method": METHOD | {"scheme": "averaged", "tensile_correction": 0.001},
        }
    )  # fmt: skip


def free(scene: Scene) -> Scene:
    """The same by velocities that keep density and have no divergence."""
    return scene.replace({"method.scheme": "divergence-free"})


def in_a_cup() -> Scene:
    """In a cup, a mesh that tips and moves, above a field and a ball that come on."""
    return Scene(
        {
            "water": {"kind": "fluid", "origin": [-0.1, -0.1, -0.1], "size": [0.2, 0.15, 0.2]},
            "cup": {
                "kind": "mesh_collider", "shape": {"name": "cup", "resolution": 4, "scale": 0.5}, "spin": [0.2, 0.0, 3.0],
                "velocity": [0.0, 0.3, 0.1], "origin": [0.0, 0.13, 0.0], "static_friction": 0.3, "dynamic_friction": 0.2,
            },
            "block": {
                "kind": "distance_field", "shape": {"name": "box", "resolution": 2, "scale": 0.2}, "spacing": 0.05,
                "origin": [0.02, -0.22, 0.0], "spin": [0.0, 2.0, 0.0], "velocity": [0.0, 0.2, 0.0],
            },
            "gravity": {},
            "method": METHOD,
        }
    )  # fmt: skip


SCENES = {
    "column": column_scene,
    "two fluids": two_fluids,
    "flat": flat,
    "averaged": averaged,
    "free column": lambda: free(column_scene()),
    "free two fluids": lambda: free(two_fluids()),
    "free flat": lambda: free(flat()),
    "cup": in_a_cup,
    "free cup": lambda: free(in_a_cup()),
}


def shaken(scene: Scene, seed: int = 1) -> State:
    """A state off the lattice, in motion, in which two particles of space lie in one place."""
    body, random = build(scene), np.random.default_rng(seed)
    position = body.position + random.uniform(-0.1, 0.1, body.position.shape) * scene.grid.spacing
    velocity = body.velocity + random.uniform(-0.3, 0.3, body.position.shape)
    if scene.dimensions == 3 and len(position) > 5:
        position[5], velocity[5] = position[4], velocity[4]
    return State(position, velocity, body.inverse_mass, 0.0, 0)


def ends(scene: Scene, steps: int, start: State, **how: Any) -> State:
    """The state after so many steps from `start`."""
    with open_simulation(scene, initial=replace(start), **how) as simulation:
        simulation.advance(steps)
        return simulation.state()
