"""The scene's description: defaults, round trips, replacement, pins, the catalogue."""

import json

import numpy as np
import pytest

from softlab.bench.reference import mass_spring as reference
from softlab.model.base.errors import SceneError
from softlab.model.contact.sheet_plan import present_parts
from softlab.model.core.build import build, pinned_indices
from softlab.model.scene.reader import catalogue, parse_settings, parse_value
from softlab.model.scene.scene import Scene, load_scene
from softlab.model.scene.sheets import rest_lines
from softlab.model.tables.kinds import REMOVED

MINIMAL = {"grid": {"rows": 3, "columns": 4}}
SETTABLE = [
    "grid.rows",
    "grid.columns",
    "grid.spacing",
    "grid.mass",
    "grid.pinned",
    "springs.stiffness",
    "springs.rest_length",
    "damping.coefficient",
    "gravity.enabled",
    "gravity.acceleration",
    "external.magnitude",
    "external.seed",
    "method.integrator",
    "method.dt",
]


def test_a_scene_that_names_no_method_gets_velocity_verlet():
    method = Scene(MINIMAL).method
    assert (method.solver, method.integrator, method.dt) == ("mass-spring", "velocity-verlet", 0.01)


def test_defaults_are_the_hand_outs():
    scene = Scene(MINIMAL | {"springs": {}, "damping": {}, "gravity": {}, "external": {}})
    assert (scene.grid.spacing, scene.grid.mass, scene.springs.rest_length) == (1.0, 0.01, 1.0)
    assert (scene.springs.stiffness, scene.damping.coefficient, scene.gravity.acceleration) == (10.0, 0.03, 9.81)
    assert (scene.gravity.enabled, scene.external.magnitude, scene.external.seed) == (True, 0.0, 0)


def test_lab_grid_is_the_hand_outs_grid():
    scene = load_scene("lab-grid")
    tables = scene.as_dict()
    for path in SETTABLE:
        part, key = path.split(".")
        assert key in tables[part], path
    assert (scene.grid.rows, scene.grid.columns, scene.grid.pinned) == (32, 32, "top-corners")
    assert (scene.grid.particle_count, scene.grid.spring_count) == (1024, 1984)
    assert (scene.method.integrator, scene.method.dt) == ("lab", 0.01)


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_every_catalogue_scene_round_trips(name):
    """as_dict() makes the same scene again; the canonical text is JSON, without the title."""
    scene = load_scene(name)
    again = Scene(scene.as_dict())
    assert again.canonical() == scene.canonical()
    assert "title" not in json.loads(scene.canonical())
    assert scene.title != name


def test_only_the_parts_a_scene_needs():
    """Rule 2: what is absent, or does nothing, has no stage."""
    assert present_parts(Scene(MINIMAL)) == set()
    still = {"damping": {"coefficient": 0.0}, "gravity": {"enabled": False}, "external": {}}
    assert present_parts(Scene(MINIMAL | still)) == set()
    assert present_parts(Scene(MINIMAL | {"gravity": {"acceleration": 0.0}})) == set()
    assert present_parts(load_scene("lab-grid")) == {"springs", "damping", "gravity", "pins"}
    live = frozenset({"gravity", "poke"})
    assert present_parts(Scene(MINIMAL | still), live) == {"gravity", "poke"}


@pytest.mark.parametrize(
    ("pinned", "expected"),
    [
        ("none", []),
        ("top", [0, 1, 2, 3, 4]),
        ("top-corners", [0, 4]),
        ("left", [0, 5, 10]),
        ("every:2", [0, 2, 4]),
        ("every:7", [0]),
        ("edges", [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14]),
        ([[2, 4], [0, 1], [2, 4]], [1, 14]),
        ([], []),
    ],
)
def test_pins(pinned, expected):
    """Flat indices, row-major, sorted, each once; the reference's own mask agrees."""
    scene = Scene({"grid": {"rows": 3, "columns": 5, "pinned": pinned}})
    assert pinned_indices(scene.grid).tolist() == expected
    assert np.flatnonzero(reference.pinned_mask(scene)).tolist() == expected
    assert np.array_equal(build(scene).inverse_mass == 0, reference.pinned_mask(scene).ravel())


@pytest.mark.parametrize("name", ["lab-grid", "lab-curtain", "lab-hammock"])
def test_start_is_the_references(name):
    """Builder and reference, written apart, put every mass in the same place (rounding: 1e-15 of 32 m)."""
    scene = load_scene(name)
    body, (position, velocity) = build(scene), reference.start(scene)
    assert np.abs(body.position - position).max() < 1e-14
    assert np.abs(body.velocity - velocity).max() < 1e-14


@pytest.mark.parametrize("kind", REMOVED)
def test_removed_kinds_are_refused_with_what_to_use_instead(kind):
    changed = pytest.raises(SceneError, match=REMOVED[kind].split(";")[0])
    with changed:
        Scene({"grid": {"rows": 2, "columns": 2}, kind: {}})
    with changed:
        load_scene("lab-grid").replace({f"{kind}.amplitude": 0.1})


def test_parts_may_have_other_names():
    scene = Scene({"sheet": {"kind": "grid", "rows": 2, "columns": 2}, "wind": {"kind": "external", "magnitude": 1.0}})
    assert scene.grid.rows == 2
    assert scene.external.magnitude == 1.0
    assert Scene(scene.as_dict()).canonical() == scene.canonical()
    assert scene.replace({"wind.magnitude": 2.0}).external.magnitude == 2.0


def test_replace_makes_a_new_scene():
    scene = load_scene("lab-grid")
    changed = scene.replace({"grid.rows": 64, "external.magnitude": 0.5, "perturbation.amplitude": 0.01})
    assert (changed.grid.rows, changed.external.magnitude, changed.perturbation.amplitude) == (64, 0.5, 0.01)
    assert scene.grid.rows == 32
    with pytest.raises(Exception, match="frozen"):
        scene.grid.rows = 5


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("64", 64),
        ("0.5", 0.5),
        ("1e-3", 1e-3),
        ("true", True),
        ("rk4", "rk4"),
        ("every:4", "every:4"),
        ("[[0, 0], [1, 2]]", [[0, 0], [1, 2]]),
        ('"top"', "top"),
        ("", ""),
        ("1\nother = 2", "1\nother = 2"),
    ],
)
def test_values_of_set(text, value):
    assert parse_value(text) == value


def test_settings():
    assert parse_settings(["grid.rows=64", "method.integrator = rk4"]) == {"grid.rows": 64, "method.integrator": "rk4"}
    assert parse_settings(None) == {}
    with pytest.raises(SceneError, match="key=value"):
        parse_settings(["grid.rows"])


def test_written_as_toml_it_reads_back(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('title = "Mine"\n[grid]\nrows = 5\ncolumns = 2\npinned = [[0, 1]]\n', encoding="utf-8")
    scene = load_scene(file)
    assert (scene.name, scene.title, scene.grid.pinned) == ("mine", "Mine", [(0, 1)])


def test_springs_that_begin_far_from_rest_are_told():
    assert rest_lines(load_scene("lab-grid")) == [] and rest_lines(load_scene("jelly-drop")) == []
    (line,) = rest_lines(load_scene("lab-grid").replace({"grid.spacing": 0.1}))
    assert line.startswith("springs begin at 0.1 of their rest length")
    tables = load_scene("lab-grid").as_dict()
    tables["grid"]["spacing"] = 0.8
    assert rest_lines(Scene(tables, "named")) == []
    del tables["springs"]["rest_length"]  # the default has to be told: 0.8 apart means springs of 0.8 to many
    assert "springs.rest_length = 1 m" in rest_lines(Scene(tables, "by default"))[0]
