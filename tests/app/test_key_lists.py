"""Every key of the window stands in the help of key H, in README.md and in the table of docs/demo.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from softlab.app.window import controls, keys

ROOT = Path(__file__).resolve().parents[2]
MICE = {"mouse", "wheel", "right", "left"}  # words for the mouse among the keys
SAME = {"NUM_ENTER": "Enter", "ENTER": "Enter", "ESCAPE": "Escape", "TAB": "Tab", "SPACE": "space", "DELETE": "Delete"}


def listed() -> set[str]:
    """The keys of the help of key H, of every kind of scene."""
    words = [key for key, _, _ in keys.KEYS] + [keys.WORLDS_KEY[0], "H"]
    return {part for word in words for part in word.split()} - MICE


def handled() -> set[str]:
    """The keys that app/window/controls.py acts on."""
    source = Path(controls.__file__).read_text(encoding="utf-8")
    named = set(re.findall(r"^            key\.(?!MOTION)([A-Z_]+):", source, re.MULTILINE))
    typed = set(re.findall(r'^            "(.)":', source, re.MULTILINE))
    return {SAME.get(name, name) for name in named} | typed | {"arrows"}


def test_the_help_of_key_h_names_every_key_that_does_something() -> None:
    assert listed() == handled() - {"Delete"}, "Delete is another name of X"


@pytest.mark.parametrize("page", ["README.md", "docs/demo.md"])
def test_every_key_stands_in_the_table_of_keys(page: str) -> None:
    table = (ROOT / page).read_text(encoding="utf-8").split("| key | what it does |")[1].split("\n\n")[0]
    first = " ".join(re.findall(r"^\| (.*?) \|", table, re.MULTILINE))
    words = re.findall(r"`([^`]+)`|\*\*([^*]+)\*\*", first)
    found = {part for pair in words for part in "".join(pair).split()} - MICE
    assert found == handled()
