"""The mesh files that a scene file names: looked for beside it, then from the current folder, whatever part names them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from softlab.app.command.scene_file import write_scene
from softlab.model.base.errors import InputError
from softlab.model.geometry.topology import mesh_path
from softlab.model.scene.scene import Scene, load_scene

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
BIGGER = TETRAHEDRON.replace("v 1 0 0", "v 2 0 0")
NAMED = {  # a scene by the part that names the file
    "mesh": '[mesh]\nfile = "{file}"\n[structural]\n[method]\nsolver = "xpbd"\n',
    "soft_body": '[some]\nkind = "soft_body"\nparticle_spacing = 0.2\nfile = "{file}"\n[method]\nsolver = "shape-matching"\n',
    "mesh_collider": "[cloth]\nrows = 2\ncolumns = 2\n[structural]\n"
    '[some]\nkind = "mesh_collider"\nfile = "{file}"\n[method]\nsolver = "xpbd"\n',
}


@pytest.fixture(params=NAMED)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """(of the scene, the current one)"""
    made = tmp_path / "scenes", tmp_path / "here"
    for folder in made:
        folder.mkdir()
    monkeypatch.chdir(made[1])
    return made


def written(folder: Path, kind: str, file: str = "some.obj") -> Path:
    path = folder / "mine.toml"
    path.write_text(NAMED[kind].format(file=file), encoding="utf-8")
    return path


def part_of(scene: Scene, kind: str) -> Any:
    return next(scene.parts[name] for name, found in scene.kinds.items() if found == kind)


def test_beside_the_scene_comes_first_then_the_current_folder(folders: tuple[Path, Path], kind: str) -> None:
    theirs, here = folders
    scene = written(theirs, kind)
    (here / "some.obj").write_text(TETRAHEDRON)
    found = part_of(load_scene(scene), kind)
    assert mesh_path(found.file) == here / "some.obj"
    (theirs / "some.obj").write_text(BIGGER)
    beside = part_of(load_scene(scene), kind)
    assert mesh_path(beside.file) == theirs / "some.obj" and beside.digest != found.digest
    (theirs / "deeper").mkdir()
    (theirs / "deeper" / "other.obj").write_text(TETRAHEDRON)
    deeper = part_of(load_scene(written(theirs, kind, "deeper/other.obj")), kind)
    assert mesh_path(deeper.file) == theirs / "deeper" / "other.obj" and deeper.digest == found.digest


def test_what_is_written_of_it_can_be_read_from_anywhere(
    folders: tuple[Path, Path], kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As stores and trajectories hold a scene, and as scene files do."""
    theirs, here = folders
    (theirs / "some.obj").write_text(TETRAHEDRON)
    scene = load_scene(Path("..") / "scenes" / written(theirs, kind).name)
    text, file = scene.canonical(), write_scene(here / "copy.toml", scene)
    monkeypatch.chdir(tmp_path)
    for again in (Scene(json.loads(text)), load_scene(file), scene.replace({"method.dt": 0.001})):
        assert part_of(again, kind).digest == part_of(scene, kind).digest
    assert load_scene(file).canonical() == text


def test_a_file_that_is_nowhere_is_told_with_both_places(folders: tuple[Path, Path], kind: str) -> None:
    theirs, here = folders
    with pytest.raises(InputError, match="no such file") as found:
        load_scene(written(theirs, kind))
    assert str(theirs / "some.obj") in str(found.value) and str(here / "some.obj") in str(found.value)
    assert "garment.obj" in str(found.value)
    with pytest.raises(InputError) as found:
        load_scene(written(here, kind).name)
    assert str(found.value).count(str(here / "some.obj")) == 1
    with pytest.raises(InputError, match="file = xxx") as found:
        load_scene(written(here, kind, "x" * 5000))
    assert len(str(found.value)) < 600


def test_the_labs_own_keep_their_names_but_not_before_what_lies_beside(folders: tuple[Path, Path]) -> None:
    theirs, here = folders
    scene = written(theirs, "mesh", "garment.obj")
    (here / "garment.obj").write_text(TETRAHEDRON)
    assert part_of(load_scene(scene), "mesh").file == "garment.obj"
    (theirs / "garment.obj").write_text(TETRAHEDRON)
    assert part_of(load_scene(scene), "mesh").file == str(theirs / "garment.obj")


def test_other_tables_have_no_files(folders: tuple[Path, Path]) -> None:
    """A misspelt table is told as such, not as a file that is missing."""
    scene = folders[0] / "mine.toml"
    scene.write_text('[grid]\nrows = 2\ncolumns = 2\nfile = "some.obj"\n')
    with pytest.raises(Exception, match="unknown key"):
        load_scene(scene)
