"""What tables of a scene file may hold: told on the terminal and in docs/scene.md, from the parts themselves."""

from __future__ import annotations

from pathlib import Path

import pytest

from model.core.errors import SceneError
from model.scene.fields import REQUIRED, about, document, rows_of
from model.scene.scene_parts import KINDS

PAGE = Path(__file__).parents[2] / "docs" / "scene.md"


def test_the_page_is_that_of_the_code() -> None:
    """Made anew: python -c 'from model.scene.fields import document; open("docs/scene.md", "w").write(document())'"""
    assert PAGE.read_text(encoding="utf-8") == document()


def test_every_kind_stands_in_the_table_of_what_it_is_for() -> None:
    rows = [line.split("|")[1] for line in document().splitlines() if line.startswith("| ") and line.count("|") == 3]
    assert sorted(", ".join(rows[1:]).replace(" ", "").split(",")) == sorted(KINDS)


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


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_told(kind: str) -> None:
    assert about(kind) and [row.name for row in rows_of(kind)] == list(KINDS[kind].model_fields)


def test_an_unknown_kind_is_told_what_it_may_be() -> None:
    with pytest.raises(SceneError, match="did you mean wind"):
        rows_of("wnd")
