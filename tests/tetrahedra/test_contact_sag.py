"""Weight on colliders, which push after the solve of a substep: the sag that follows, and the note where it is large."""

from __future__ import annotations

from math import atan, cos, degrees, sin

import numpy as np
import pytest

from softlab.app.command.run import Request, run_scene
from softlab.app.driver import open_simulation
from softlab.model.scene.scene import Scene
from softlab.model.tetrahedra.contact_sag import SAG, contact_sag, sag_lines

EDGE, SIDE, G = 0.1, 0.3, 9.81


def cube(tilt: float = 0.0, mu: float = 0.0, **method: object) -> Scene:
    """A cube of three voxels along each side that lies on a slope of `tilt` radians."""
    up = SIDE / 2 + 1e-9
    body = {
        "kind": "tetrahedral_body", "shape": {"name": "box", "sides": [SIDE] * 3, "resolution": 4}, "edge": EDGE,
        "young_modulus": 1e5, "angle": -degrees(tilt), "axis": [0.0, 0.0, 1.0],
        "origin": [up * sin(tilt), up * cos(tilt), 0.0],
    }  # fmt: skip
    floor = {
        "kind": "plane", "point": [0.0, 0.0, 0.0], "normal": [sin(tilt), cos(tilt), 0.0], "thickness": 0.0,
        "static_friction": mu, "dynamic_friction": mu,
    }  # fmt: skip
    settings = {"solver": "xpbd", "dt": 1 / 60, "substeps": 1} | method
    return Scene({"cube": body, "floor": floor, "gravity": {"acceleration": G}, "method": settings}, "cube")


def lowest_layer(substeps: int) -> float:
    """Height of the lowest layer of voxels at rest [m]."""
    scene = cube(substeps=substeps)
    start = scene.tetrahedra_set.position[:, 1]
    second = np.abs(start - start.min() - EDGE) < 1e-6
    with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
        simulation.advance(240)
        return float(simulation.read("position")[second, 1].mean())


def test_weight_shortens_the_lowest_layer_by_what_a_collider_takes_back_in_a_substep() -> None:
    """g h^2 M/m, M/m = 6: a sixth of a cube of three layers lies on the floor."""
    shorter = lowest_layer(4) - lowest_layer(1)
    assert shorter == pytest.approx(6 * G * (1 / 60) ** 2 * (1 - 1 / 16), rel=0.05)


def test_a_run_notes_it_and_names_substeps_that_hold() -> None:
    """Which leave a cube at rest on a slope below the cone; with one substep it goes on."""
    mu, tilt = 0.5, atan(0.45)
    (note,) = [note for note in run_scene(cube(tilt, mu), Request(steps=0), progress=False).notes if "solve" in note]
    substeps = int(note.split("method.substeps = ")[1].split()[0])
    good = cube(tilt, mu, substeps=substeps)
    assert contact_sag(good)[0] <= SAG and sag_lines(good) == []
    assert sag_lines(cube(tilt, mu, solver="newton")) == []
    down, speeds = np.array([cos(tilt), -sin(tilt), 0.0]), []
    for scene in (good, cube(tilt, mu)):
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            simulation.advance(60)
            mass = scene.tetrahedra_set.masses
            speeds.append(float(mass @ simulation.state().velocity @ down / mass.sum()))
    assert abs(speeds[0]) < G * scene.method.dt / substeps * sin(tilt)
    assert speeds[1] > 1.0, "one substep holds it, too: the note is not needed"
