"""What xpbd tetrahedra cannot bear at rest: damping that sweeps do not resolve, and long substeps on colliders, which push
after an iteration. A run notes both; no catalogue scene has them."""

from __future__ import annotations

from math import atan, cos, degrees, sin
from pathlib import Path

import numpy as np
import pytest

from softlab.app.command.run import Request, run_scene
from softlab.app.driver import open_simulation
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.tetrahedra.contact_sag import SAG, contact_sag, sag_lines
from softlab.model.tetrahedra.damping_load import UNRESOLVED, damping_lines, damping_load

CATALOGUE = Path(__file__).parents[2] / "model" / "catalogue"
BODIES = sorted(path.stem for path in CATALOGUE.glob("*.toml") if "tetrahedral_body" in path.read_text())
BOX = {
    "kind": "tetrahedral_body",
    "shape": {"name": "box", "sides": [0.2, 0.1, 0.1]},
    "edge": 0.1,
    "young_modulus": 1e6,
}


def boxes(tau: float, **method: object) -> Scene:
    return Scene(
        {"one": BOX | {"damping": tau}, "two": BOX, "method": {"solver": "xpbd", "dt": 1 / 60} | method}, "boxes"
    )


@pytest.mark.parametrize("name", BODIES)
def test_no_catalogue_scene_damps_more_than_it_resolves_or_sags_on_colliders(name: str) -> None:
    assert damping_lines(load_scene(name)) == sag_lines(load_scene(name)) == []


def test_the_load_is_that_of_its_formula() -> None:
    """tau h E / (rho e^2), over the iterations; e is the mean edge of a voxel's surface, between its side and diagonal."""
    load = damping_load(boxes(0.1, substeps=4, iterations=2))
    side = 0.1 * (1 / 240) * 1e6 / (1000 * 0.1**2) / 2
    assert side / 2 < load[0] < side and load[1] == 0
    assert damping_load(boxes(0.1, substeps=8, iterations=2))[0] == pytest.approx(load[0] / 2)
    assert damping_load(boxes(0.1, substeps=4, iterations=4))[0] == pytest.approx(load[0] / 2)
    assert damping_load(boxes(0.05, substeps=4, iterations=2))[0] == pytest.approx(load[0] / 2)


def test_a_run_notes_it_and_names_what_helps() -> None:
    result = run_scene(boxes(0.1), Request(steps=0), progress=False)
    (note,) = [note for note in result.notes if "one.damping = 0.1 s" in note]
    limit = 0.1 / damping_load(boxes(0.1))[0]
    assert f"reduce it to {limit:.2g} s" in note and damping_lines(boxes(limit)) == []
    times = int(note.split("take ")[1].split()[0])
    substeps = times * boxes(0.1).method.substeps
    assert damping_load(boxes(0.1, substeps=substeps))[0] <= 1 < UNRESOLVED
    assert damping_lines(boxes(0.0)) == [] and damping_lines(boxes(0.1, solver="newton")) == []


# ---------------------------------------------------------------------- weight on colliders

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


def test_a_run_notes_a_sag_and_names_substeps_that_hold() -> None:
    """And iterations, which leave a cube at rest on a slope below the cone; with one of each it goes on."""
    mu, tilt = 0.5, atan(0.45)
    (note,) = [
        note for note in run_scene(cube(tilt, mu), Request(steps=0), progress=False).notes if "push after" in note
    ]
    substeps = int(note.split("method.substeps = ")[1].split()[0])
    iterations = int(note.split("method.iterations = ")[1].split(",")[0])
    good = [cube(tilt, mu, substeps=substeps), cube(tilt, mu, iterations=iterations)]
    for scene in good:
        assert contact_sag(scene)[0] <= SAG and sag_lines(scene) == []
    assert sag_lines(cube(tilt, mu, solver="newton")) == []
    down, speeds = np.array([cos(tilt), -sin(tilt), 0.0]), []
    for scene in (*good, cube(tilt, mu)):
        with open_simulation(scene, "cpu", precision="float64", math="exact", threads=1) as simulation:
            simulation.advance(60)
            mass = scene.tetrahedra_set.masses
            speeds.append(float(mass @ simulation.state().velocity @ down / mass.sum()))
    assert abs(speeds[0]) < G * scene.method.dt / substeps * sin(tilt)
    assert abs(speeds[1]) < G * scene.method.dt * sin(tilt)
    assert speeds[2] > 1.0, "one of each holds it, too: the note is not needed"
