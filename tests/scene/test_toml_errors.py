"""Errors of TOML syntax: the line, the rule that it breaks, and how to write it, which must itself be TOML."""

from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softlab.model.base.errors import InputError
from softlab.model.scene.scene import load_scene
from softlab.model.scene.toml_errors import plain_error

MISTAKES = (  # a line of a table, and what the message must say
    ("pinned = left", 'a word stands in quotes; write pinned = "left"'),
    ("pinned = left  # side", 'write pinned = "left"  # side'),
    ("pinned = [left, right]", 'write pinned = ["left", "right"]'),
    ("kind: cloth", 'separated by =, and a word stands in quotes; write kind = "cloth"'),
    ("rows 3", "separated by =; write rows = 3"),
    ("rows == 3", "write rows = 3"),
    ("rows =", "there is no value"),
    ("x = None", "delete this line"),
    ("ok = True", "lower case; write ok = true"),
    ("point = [1.0 2.0]", "commas; write point = [1.0, 2.0]"),
    ("point = [1.0, 2.0", "not closed in its line; write point = [1.0, 2.0]"),
    ("point = 1.0, 2.0]", "line 3: point = 1.0, 2.0]"),
    ("point = (1.0, 2.0)", "brackets: [ ]; write point = [1.0, 2.0]"),
    ("shape = {sides = 0.4", "write shape = {sides = 0.4}"),
    ("shape = {sides = 0.4 radius = 1}", "commas; write shape = {sides = 0.4, radius = 1}"),
    ("shape = {sides = 0.4,\n radius = 1}", "one line"),
    ("rows = 3 columns = 4", "write rows = 3 and, in the next line, columns = 4"),
    ("rows = 3,", "ends a line; write rows = 3"),
    ("x = 1,5", "point; write x = 1.5"),
    ("springs = { stiffness = 20,0 }", "write springs = { stiffness = 20.0 }"),
    ("a = { b = 1,5, c = 2 }", "write a = { b = 1.5, c = 2 }"),
    ("springs = { stiffness = 20.0", "closed in its line; write springs = { stiffness = 20.0}"),
    ("x = .5", "write x = 0.5"),
    ("x = 5.", "write x = 5.0"),
    ("x = 05", "write x = 5"),
    ("x = 1.5 m/s", "comment; write x = 1.5  # m/s"),
    ('kind = "cloth', 'write kind = "cloth"'),
    ("kind = 'cloth", "write kind = 'cloth'"),
    ("kind = \N{LEFT DOUBLE QUOTATION MARK}cloth\N{RIGHT DOUBLE QUOTATION MARK}", 'straight: "; write kind = "cloth"'),
    ("\N{NO-BREAK SPACE}rows = 3", "invisible"),
    ('file = "C:\\scans\\x.obj"', 'write file = "C:/scans/x.obj"'),
    ("// a comment", "write # a comment"),
    ("size = 2.0\nsize = 3.0", "size is given twice, first in line 3: keep one"),
    ("[plane", "write [plane]"),
    ("[plane] friction = 0.5", "write [plane] and, in the next line, friction = 0.5"),
    ("[two planes]", "no spaces; write [two_planes]"),
    ("[first]\n[first]", 'first in line 3: give the second another name and, below it, kind = "first"'),
)  # fmt: skip


def message_of(text: str) -> str:
    with pytest.raises(tomllib.TOMLDecodeError) as caught:
        tomllib.loads(text)
    return plain_error(text, caught.value)


@pytest.mark.parametrize("line,words", MISTAKES)
def test_a_mistake_is_explained_and_corrected(line: str, words: str) -> None:
    message = message_of(f"[gravity]\n\n{line}\n\n[last]\nrows = 3\n")
    assert message.startswith(("line 3: ", "line 4: ")) and words in message, message
    if "; write " in message:
        tomllib.loads(message.partition("; write ")[2].replace(" and, in the next line, ", "\n"))


def test_a_list_of_several_lines_is_named_where_it_begins() -> None:
    assert "line 2: size = [1.0, 2.0: a bracket" in message_of("[a]\nsize = [1.0, 2.0\n")
    assert "line 2: size = [1.0,: the list that begins here" in message_of("[a]\nsize = [1.0,\n  2.0\n[plane]\n")


def test_json_and_words_of_a_scene_file(tmp_path) -> None:
    assert "this is JSON" in message_of('{"grid": {"rows": 3}}')
    file = tmp_path / "mine.toml"
    file.write_text("[cloth]\nrows = 4\npinned = left\n")
    with pytest.raises(InputError, match=r'mine\.toml is not TOML: line 3: .*write pinned = "left"'):
        load_scene(file)


@given(st.text(st.sampled_from("ab=[]{}\"'#,.:;01 \n\\\t\u00a0"), max_size=40))
def test_any_text_gets_one_line(text: str) -> None:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        message = plain_error(text, error)
        assert message and "\n" not in message
