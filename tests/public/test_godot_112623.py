"""Far from the origin. A body at rest in map coordinates, 5 000 km away, was called diverged, since a coordinate was compared
with the scene's size; and in float32, 10 km away, bodies hung in the air without a word."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from softlab.app.command.run import Request, run_scene
from softlab.app.driver import open_simulation
from softlab.model.base.errors import Diverged
from softlab.model.core.simulation import State
from softlab.model.core.stability.resolution import resolution_line
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import Scene, load_scene

BOX = {"kind": "tetrahedral_body", "shape": {"name": "box", "sides": [1.0, 1.0, 1.0]}, "edge": 0.5}
LUMP = {"shape": {"name": "box", "sides": [0.2, 0.2, 0.2]}, "particle_spacing": 0.1}
METHODS: dict[str, dict[str, Any]] = {
    "newton": {"solver": "newton", "dt": 0.0166, "substeps": 4}, "vbd": {"solver": "vbd", "dt": 0.0166},
    "rows": {"solver": "xpbd", "dt": 0.0166}, "blocks": {"solver": "xpbd", "rows": "blocks", "dt": 0.0166},
}  # fmt: skip


def far(at: tuple[float, float, float]) -> dict[str, Scene]:
    """A scene of each family that lies at rest at `at` [m]."""
    matching = {"solver": "shape-matching", "dt": 0.01}
    sheet = {"rows": 3, "columns": 3, "spacing": 0.25, "origin": list(at), "pinned": "none"}
    springs = {"structural": {"stiffness": 10.0}}
    return {
        **{name: Scene({"box": BOX | {"origin": list(at)}, "method": method}, name) for name, method in METHODS.items()},
        "soft": Scene({"lump": LUMP | {"kind": "soft_body", "origin": list(at)}, "method": matching}, "soft"),
        "rigid": Scene({"lump": LUMP | {"kind": "rigid_body", "origin": list(at)}, "method": matching}, "rigid"),
        "cloth": Scene({"cloth": sheet, **springs, "method": {"dt": 0.001}}, "cloth"),
        "cloth xpbd": Scene({"cloth": sheet, **springs, "method": {"solver": "xpbd", "dt": 0.001}}, "cloth xpbd"),
        "fluid": Scene(
            {
                "water": {"kind": "fluid", "size": [0.2, 0.2, 0.2], "rest_distance": 0.1, "origin": list(at)},
                "method": {"solver": "pbf", "dt": 0.001, "substeps": 1, "iterations": 1},
            },
            "fluid",
        ),
        "world": Scene(
            {
                "box": BOX | {"origin": list(at)},
                "lump": LUMP | {"kind": "soft_body", "origin": [at[0] + 3.0, *at[1:]]},
                "method": {"solver": "world", "dt": 0.0166, "substeps": 2},
            },
            "world",
        ),
    }  # fmt: skip


NAMES = list(far((0.0, 0.0, 0.0)))


@pytest.mark.parametrize("name", NAMES)
def test_a_body_at_rest_far_away_stays(name: str) -> None:
    """A thousandth of a millimetre, of some thousand ulps of 5e6 m (9e-10 m): they are what rounding may move it by."""
    for at in ((0.0, 5e6, 0.0), (-2e7, 0.0, 1.0)):
        scene = far(at)[name]
        with open_simulation(scene, threads=1, precision="float64") as simulation:
            start = simulation.read("position").copy()
            simulation.advance(1)
            simulation.check()
            assert np.abs(simulation.read("position") - start).max() < 1e-6


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("side", [-1, 1])
def test_what_leaves_its_place_is_found_wherever_that_is(name: str, side: int) -> None:
    """Just within a million sizes of the centre all is well; just beyond, and at infinity, the particle is named."""
    scene = far((3e6, -5e6, 0.0))[name]
    with open_simulation(scene, threads=1, precision="float64") as simulation:
        centre = simulation.body.centre
        assert np.allclose(centre[:2], [3e6, -5e6], atol=4.0)
        members = getattr(simulation, "members", {})
        bound = next(iter(members.values()))._bound if members else simulation._bound
        for axis in range(3):
            middle = (next(iter(members.values())).body.centre if members else centre)[axis]
            for value, bad in (
                (middle + 0.999 * side * bound, False), (middle + 1.001 * side * bound, True), (np.inf * side, True),
            ):  # fmt: skip
                position, velocity = simulation._download()
                position[2, axis] = value
                simulation._upload(position, velocity)
                assert simulation._first_diverged() == (2 if bad else -1)
                simulation.reset()


@pytest.mark.parametrize("size", [None, [0.2, 0.2, 0.2]])  # m: starts empty, or far from its nozzle
def test_a_far_nozzle_belongs_to_the_place_of_a_scene(size: list[float] | None) -> None:
    """Three steps of 20 ms at 2 m/s: a layer of a hundred millimetres leaves the nozzle at a height of 5000 km."""
    tables = {
        "water": {"kind": "fluid", "capacity": 20, "rest_distance": 0.1} | ({"size": size} if size else {}),
        "nozzle": {"kind": "emitter", "center": [0.0, 5e6, 0.0], "radius": 0.1, "speed": 2.0},
        "gravity": {}, "method": {"solver": "pbf", "dt": 0.02, "substeps": 1, "iterations": 1},
    }  # fmt: skip
    scene = Scene(tables, "nozzle")
    with open_simulation(scene, threads=1, precision="float64") as simulation:
        simulation.advance(3)
        simulation.check()
        height = simulation.read("position")[:, 1]
    assert np.any(np.abs(height - 5e6) < 0.2)
    assert "5e+06 m" in str(resolution_line(scene, "float32")) and resolution_line(scene, "float64") is None


def test_a_far_scene_that_does_diverge_is_found() -> None:
    scene = far((0.0, 5e6, 0.0))["cloth"].replace({"structural.stiffness": 1e6, "method.dt": 0.1})
    with open_simulation(scene, threads=1, precision="float64", allow_unstable=True) as simulation:
        state = simulation.state()
        state.position[4, 0] += 0.1
        simulation.load(state)
        with pytest.raises(Diverged):
            simulation.advance(300)
            simulation.check()


def falling(height: float, precision: str = "float32", **method: Any) -> tuple[Scene, str | None]:
    tables = {"solver": "xpbd", "dt": 1 / 60, "substeps": 4} | method
    scene = Scene({"box": BOX | {"origin": [0.0, height, 0.0]}, "gravity": {}, "method": tables}, "falling")
    return scene, resolution_line(scene, precision)


def test_where_a_fall_is_lost_in_rounding_the_run_says_so() -> None:
    """At 10 km an ulp of float32 is 2^-10 m; g h^2 is 1.7e-4 m. The body hangs, and both the notes and the report say why."""
    scene, line = falling(1e4)
    assert line is not None
    for words in (
        "float32",
        "1e+04 m from the origin",
        "0.00098 m",
        "0.00017 m",
        "--precision float64",
        "fewer substeps",
    ):
        assert words in line
    result = run_scene(scene, Request(steps=1, precision="float32"), progress=False)
    assert line in result.notes and result.report["resolution"] == line
    json.dumps(result.report)
    fine = run_scene(scene, Request(steps=1, precision="float64"), progress=False)
    assert fine.report["resolution"] is None and not any("too coarse" in note for note in fine.notes)
    assert np.ptp(result.state.position[:, 1] - fine.state.position[:, 1]) < 1e-3  # either hangs or falls as a whole


def test_the_note_is_about_the_height_and_the_substep() -> None:
    assert falling(-1e4)[1] is not None and falling(100.0)[1] is None
    assert falling(1e4, substeps=1)[1] is None  # g h^2 is 2.7e-3 m
    assert falling(9e8, "float64", substeps=1000)[1] is not None and falling(9e8, "float64")[1] is None
    assert resolution_line(far((1e4, 0.0, 0.0))["rows"], "float32") is None  # nothing falls
    east = falling(100.0)[0].replace({"box.origin": [1e4, 100.0, 0.0]})
    assert resolution_line(east, "float32") is None  # heights are small, and gravity changes nothing else


def test_a_velocity_that_is_kept_for_itself_falls_for_longer() -> None:
    """An explicit sheet of short steps falls by more than an ulp after a frame, though not in its first step."""
    sheet = {"rows": 3, "columns": 3, "spacing": 0.25, "pinned": "none"}
    for height, said in ((2.0, False), (1e4, True)):
        tables = {"cloth": sheet | {"origin": [0.0, height, 0.0]}, "gravity": {}, "method": {"dt": 1e-4}}
        line = resolution_line(Scene(tables, "sheet"), "float32")
        assert (line is not None) == said
        assert line is None or "a larger method.dt" in line


@pytest.mark.parametrize("name", [name for name in catalogue() if not name.startswith("soft-")])
def test_no_scene_of_the_catalogue_is_too_far_away(name: str) -> None:
    assert resolution_line(load_scene(name), "float32") is None


CASE = """
title = "A metre at rest, in map coordinates"
[box]
kind = "tetrahedral_body"
shape = { name = "box", sides = [1.0, 1.0, 1.0] }
edge = 0.5
origin = [0.0, 5e6, 0.0]
[method]
solver = "newton"
dt = 0.0166
substeps = 4
"""


def test_the_case_that_was_reported(tmp_path: Path) -> None:
    path = tmp_path / "far_at_rest.toml"
    path.write_text(CASE)
    scene = load_scene(str(path))
    result = run_scene(scene, Request(steps=1, precision="float64"), progress=False)
    assert result.diverged is None and result.report["outcome"] == "ok"
    assert (
        isinstance(result.state, State) and np.abs(result.state.position - scene.tetrahedra_set.position).max() < 1e-6
    )
