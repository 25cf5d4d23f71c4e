"""Scene files that an answer of softlab advise is written to: what is read back is the same scene."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_advise import small

from softlab.app.command.scene_file import scene_toml, write_scene
from softlab.model.base.errors import InputError
from softlab.model.scene.reader import catalogue
from softlab.model.scene.scene import Scene, load_scene

# ---------------------------------------------------------------------- the file that --write makes

WORDS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)  # lone surrogates are no text in UTF-8


@pytest.mark.parametrize("name", list(catalogue()))
def test_a_written_scene_is_the_same_scene(name, tmp_path):
    scene = load_scene(name)
    path = write_scene(tmp_path / "scene.toml", scene, "of tests")
    read = load_scene(path)
    assert read.canonical() == scene.canonical()
    assert read.title == scene.title
    assert path.read_text().startswith("# of tests\n")


@settings(deadline=None, max_examples=100)
@given(WORDS, st.floats(1e-300, 1e300), WORDS, st.booleans())
def test_whatever_a_scene_holds_comes_back(tmp_path_factory, title, number, part, pins):
    """Any title, any number, any name of a part, pins as a word or a list."""
    if part in ("title", "springs", "method"):
        return
    data = {
        "title": title,
        part: {"kind": "grid", "rows": 2, "columns": 2, "spacing": number, "pinned": [[0, 1]] if pins else "top"},
        "springs": {"stiffness": number},
    }
    scene = Scene(data)
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(scene_toml(scene), encoding="utf-8")
    read = load_scene(path)
    assert read.canonical() == scene.canonical()
    assert read.title == title


def test_an_older_file_is_named_and_kept(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"mine\.toml exists already.*--force"):
        write_scene(path, small())
    assert path.read_text() == "mine"
    write_scene(path, small(), force=True)
    assert load_scene(path).canonical() == small().canonical()
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]
    for wrong in (tmp_path / "scene.txt", tmp_path / "nowhere" / "scene.toml", tmp_path):
        with pytest.raises(InputError):
            write_scene(wrong, small())
