"""What tables of a scene file may hold: told on the terminal and in docs/scene.md, from the parts themselves."""

from __future__ import annotations

import re
import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from softlab.app.command.tables import print_fields
from softlab.app.driver import open_simulation
from softlab.model.base.errors import SceneError
from softlab.model.base.pins import PIN_WORDS
from softlab.model.geometry.strokes import letters
from softlab.model.scene.fields import REQUIRED, about, document, rows_of
from softlab.model.scene.scene import Scene
from softlab.model.tables.kinds import KINDS
from softlab.model.tables.parts import CAMERA
from softlab.model.tables.tank import TANK

TEXT = (Path(__file__).parents[2] / "docs" / "scene.md").read_text(encoding="utf-8")


def test_the_page_is_that_of_the_code() -> None:
    """Renewed by putting the text of `document` between the table of kinds and the examples."""
    assert TEXT[TEXT.index("\n## ") : TEXT.index("\n## Examples")] == document()


def test_every_word_for_pins_is_told() -> None:
    """Of grids and of cloths; `none` is the default."""
    for kind in ("grid", "cloth"):
        (row,) = [row for row in rows_of(kind) if row.name == "pinned"]
        assert {*PIN_WORDS} - {"none"} <= {*re.split(r"[ ,]+", row.note)}, kind


def test_every_kind_stands_in_the_table_of_what_it_is_for() -> None:
    rows = [line.split("|")[1] for line in TEXT.splitlines() if line.startswith("| ") and line.count("|") == 3]
    assert sorted(", ".join(rows[1:]).replace(" ", "").split(",")) == sorted([*KINDS, TANK, CAMERA])


def test_fields_bounds_and_units_are_the_parts() -> None:
    rows = {row.name: row for row in rows_of("grid")}
    assert (rows["rows"].default, rows["rows"].allowed, rows["rows"].note) == (REQUIRED, ">= 1", "masses")
    assert (rows["mass"].default, rows["mass"].allowed, rows["mass"].note) == ("0.01", "> 0", "kg, each")
    wind = {row.name: row for row in rows_of("wind")}
    assert (wind["gust"].allowed, wind["velocity"].default, wind["velocity"].note) == (
        ">= 0, <= 1",
        "[0.0, 0.0, 5.0]",
        "m/s",
    )
    assert {row.name: row.allowed for row in rows_of("method")}[
        "solver"
    ] == "mass-spring, xpbd, pbd, shape-matching, vbd, newton, pbf, world"
    assert {row.name: row.note for row in rows_of("sphere")}["thickness"] == "m"  # of every collider


@pytest.mark.parametrize("text", re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL))
def test_the_examples_of_the_page_are_scenes(text: str) -> None:
    scene = Scene(tomllib.loads(text))
    assert scene.grid.particle_count > 10 and scene.title != "untitled"


def test_the_world_of_the_page_runs_with_all_its_families() -> None:
    """A step by the solvers of water, bodies, tetrahedra and cloth, and by what couples them; of one substep and twice the
    spacing, to be quick."""
    (text,) = [text for text in re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL) if '"world"' in text]
    scene = Scene(tomllib.loads(text))
    assert list(scene.members) == ["bodies", "tetrahedra", "fluid"] and scene.members["tetrahedra"].mesh
    coarse = {"water.rest_distance": 0.05, "brick.particle_spacing": 0.05}
    coarse |= {"cloth.rows": 7, "cloth.columns": 7, "cloth.spacing": 0.05, "method.substeps": 1, "method.iterations": 1}
    with open_simulation(scene.replace(coarse)) as simulation:
        simulation.advance(1)
        assert np.isfinite(simulation.read("position")).all()


def test_letters_are_those_that_there_are() -> None:
    assert f"of {' '.join(letters())};" in about("shape")


def test_a_fluid_is_solved_alike_with_a_method_that_says_no_more_and_with_none() -> None:
    water = {"kind": "fluid", "size": [0.2, 0.2, 0.2]}
    none, bare = (Scene({"water": water} | more) for more in ({}, {"method": {"solver": "pbf"}}))
    assert none.canonical() == bare.canonical()
    method = Scene({"water": water, "method": {"solver": "pbf", "substeps": 1}}).method
    assert (method.substeps, method.dt, method.iterations) == (1, none.method.dt, none.method.iterations)


def test_the_terminal_shows_every_field_on_eighty_columns() -> None:
    """Every word of a note is there, wrapped."""
    for kind in ("method", "fluid", "tetrahedral_body"):
        page = StringIO()
        print_fields(Console(file=page, width=80), kind)
        lines = page.getvalue().splitlines()
        assert max(map(len, lines)) <= 80
        shown = " ".join(page.getvalue().split())
        for row in rows_of(kind):
            assert any(line.startswith(f"{row.name} ") for line in lines)
            assert all(word in shown for word in row.note.split())


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_told(kind: str) -> None:
    assert about(kind) and [row.name for row in rows_of(kind)] == list(KINDS[kind].model_fields)


def test_an_unknown_kind_is_told_what_it_may_be() -> None:
    with pytest.raises(SceneError, match="did you mean wind"):
        rows_of("wnd")
