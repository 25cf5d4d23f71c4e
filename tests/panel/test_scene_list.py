"""The panel's lists of scenes: titles, a search field, own files, and only scenes that can stand side by side; tooltips."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from softlab.app.command.dear_imgui import REMEDY
from softlab.app.window.panel.scene_list import matching, scene_entries
from softlab.app.window.panes import check_alike, view_kind
from softlab.model.base.errors import SceneError
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import Scene, load_scene

GRID = {"grid": {"rows": 4, "columns": 4, "pinned": "top"}, "springs": {}, "gravity": {}, "method": {"dt": 0.01}}
OWN = 'title = "My net"\n[grid]\nrows = 3\ncolumns = 5\n[springs]\n[gravity]\n'


def test_every_scene_of_the_catalogue_is_listed_with_its_title_and_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    entries = scene_entries()
    names = [entry.name for entry in entries]
    assert set(names) == set(catalogue()) and names[0] == "cloth-compute" and "hard/" in names[-1]
    for entry in entries:
        scene = load_scene(entry.name)
        assert (entry.title, entry.kind) == (scene.title, view_kind(scene))


def test_own_files_come_first_and_others_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("net.toml").write_text(OWN)
    Path("water.toml").write_text('[drop]\nkind = "fluid"\ndimensions = 2\nsize = [0.1, 0.1]\nrest_distance = 0.02\n')
    Path("pyproject.toml").write_text("[project]\nname = 'x'\n")
    Path("broken.toml").write_text("[grid\n")
    own = scene_entries()[: -len(catalogue())]
    assert [(entry.name, entry.title, entry.kind) for entry in own] == [
        ("net.toml", "My net", "masses in a plane"), ("water.toml", "water", "a fluid in 2 dimensions"),
    ]  # fmt: skip
    Path("net.toml").write_text(OWN.replace("My", "Your"))
    os.utime("net.toml", (1.0, 1.0))
    assert scene_entries()[0].title == "Your net", "each version is read"


def test_the_search_takes_every_word_in_any_case() -> None:
    entries = scene_entries()
    found = matching(entries, "JELLY two")
    assert found and all("jelly" in entry.label.lower() and "two" in entry.label.lower() for entry in found)
    assert matching(entries, "  ") == entries and not matching(entries, "no such scene")


def test_what_a_list_beside_a_scene_holds_is_not_refused() -> None:
    entries = scene_entries()
    for name in ("lab-grid", "cloth-hanging", "two-worlds", "dam-break", "fem-drop"):
        first = load_scene(name)
        for entry in entries:
            if entry.kind == view_kind(first):
                check_alike([first, load_scene(entry.name)])
            elif entry.name in ("lab-curtain", "cloth-flag", "jelly-drop", "column"):
                with pytest.raises(SceneError, match="choose scenes of one kind"):
                    check_alike([first, load_scene(entry.name)])


# ---------------------------------------------------------------------- in the panel


def test_a_scene_is_found_by_its_title_and_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("imgui_bundle", reason=f"the panel needs Dear ImGui: {REMEDY}")
    from panel_stage import Stage

    monkeypatch.chdir(tmp_path)
    Path("net.toml").write_text(OWN)
    with Stage(Scene(GRID)) as stage:
        stage.click("Scene")
        assert "Scene net.toml" in stage.state.places
        stage.context.text("my NET")
        stage.frames()
        assert "Scene lab-grid" not in stage.state.places, "the search field takes what is typed"
        stage.click("Scene net.toml")
        assert stage.demo.titles == ["My net"] and len(stage.demo.position) == 15
        stage.viewer.space = False
        stage.click("Add")
        assert "Add net.toml" in stage.state.places and "Add cloth-flag" not in stage.state.places
        stage.context.text("net.toml")
        stage.frames()
        for down in (True, False):
            stage.context.key("RETURN", down)
            stage.frames(2)
        assert [len(position) for position in stage.demo.positions] == [15, 15], "Enter takes the first one"
        assert "Add net.toml" not in stage.state.places, "the list is closed"


def test_a_tooltip_covers_nothing_of_the_panel() -> None:
    pytest.importorskip("imgui_bundle", reason=f"the panel needs Dear ImGui: {REMEDY}")
    from panel_stage import Stage

    with Stage(Scene(GRID), judge=lambda *_: (1e-3, None)) as stage:
        stage.click("Measure the error now")
        stage.frames(60)  # the pointer rests on it
        left, top, right, bottom = stage.state.places["tooltip"]
        assert stage.state.error == "error 1.00e-03 spacings at 0.000 s"
        assert 0 <= left < right <= stage.viewer.shown_width and top >= 0 and bottom > top
