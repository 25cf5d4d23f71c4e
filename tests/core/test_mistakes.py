"""The deliberate mistakes themselves: each can be made, once, where it says, and what makes them touches no checkout."""

from __future__ import annotations

import ast
import re
import threading
import time
from functools import cache
from pathlib import Path

import pytest
from mistakes.mistake import ROOT, Mistake, mistakes_of, path_of
from mistakes.run import HANGS, NO_TEST, NOTICED, SURVIVED, Copy, try_all
from mistakes.table import MISTAKES


@cache
def names_in(file: str) -> set[str]:
    """The test functions of a file under tests/."""
    tree = ast.parse((ROOT / path_of(file)).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_names_are_their_own() -> None:
    names = [mistake.name for mistake in MISTAKES]
    assert len(names) == len(set(names)) >= 92
    assert len({(m.file, m.old, m.new) for m in MISTAKES}) == len(MISTAKES)


@pytest.mark.parametrize("mistake", MISTAKES, ids=[mistake.name for mistake in MISTAKES])
def test_every_mistake_can_be_made(mistake: Mistake) -> None:
    """Its text stands in the file once, what it becomes is another text that Python can read, and its tests are there."""
    text = mistake.read()
    changed = mistake.applied(text)
    assert changed != text
    assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(text)), "a comment is no mistake"
    assert mistake.tests
    for test in mistake.tests:
        file, *name = test.split("::")
        assert (ROOT / path_of(file)).is_file(), file
        assert not name or re.sub(r"\[.*", "", name[0]) in names_in(file), test


def test_all_floors_and_both_backends_have_some() -> None:
    floors = {mistake.file.split("/")[0] for mistake in MISTAKES}
    assert {"model", "cpu_backend", "gpu_backend", "bench", "plots", "labbook", "app", "softlab"} <= floors


def test_a_text_that_is_not_there_once_is_refused() -> None:
    (mistake,) = mistakes_of({"file.py": {"test_x.py": {"made up": ("a", "b")}}})
    assert mistake.applied("xay") == "xby"
    for text in ("xyz", "xaya"):
        with pytest.raises(ValueError, match="must stand there once"):
            mistake.applied(text)


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout of one module and its tests, and temporary folders beside it."""
    checkout = tmp_path / "checkout"
    for folder in ("model", "tests", "model/__pycache__"):
        (checkout / folder).mkdir(parents=True)
    (checkout / "model" / "half.py").write_text("def half(x):\n    return x / 2\n\n\ndef unused(x):\n    return x\n")
    (checkout / "model" / "__pycache__" / "old.pyc").write_text("")
    (checkout / "tests" / "test_half.py").write_text(
        "from model.half import half\n\n\ndef test_half():\n    assert half(4) == 2\n"
    )
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    return checkout


def test_mistakes_are_noticed_or_survive_and_the_checkout_stays(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Copy, "__init__", lambda self, init=Copy.__init__: init(self, tree))
    made = mistakes_of({"model/half.py": {
        "test_half.py": {
            "a third": ("return x / 2", "return x / 3"),
            "not Python": ("return x / 2", "return x /"),
            "for ever": ("return x / 2", "return __import__('time').sleep(999)"),
            "unseen": ("return x\n", "return -x\n"),
        },
        "test_half.py::test_none": {"no such test": ("return x / 2", "return x")},
    }})  # fmt: skip
    before = {path: path.read_bytes() for path in tree.rglob("*") if path.is_file()}
    heard: list[str] = []
    results = try_all(made, timeout=15.0, tell=lambda result: heard.append(result.mistake.name))
    outcomes = {result.mistake.name: result.outcome for result in results}
    assert outcomes == {
        "a third": NOTICED, "not Python": NOTICED, "for ever": HANGS, "unseen": SURVIVED, "no such test": NO_TEST,
    }  # fmt: skip
    assert sorted(heard) == sorted(outcomes)
    assert {path: path.read_bytes() for path in tree.rglob("*") if path.is_file()} == before
    assert not list((tree.parent / "temporary").iterdir())


def test_ctrl_c_ends_what_runs_and_leaves_nothing(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copies: list[Copy] = []

    def init(self: Copy, real=Copy.__init__) -> None:  # type: ignore[no-untyped-def]
        real(self, tree)
        copies.append(self)

    join = threading.Thread.join

    def interrupted(thread: threading.Thread, timeout: float) -> None:
        """The first wait is when Ctrl-C comes, once the tests run."""
        if timeout == 0.2:
            while not copies[0]._running:
                time.sleep(0.01)
            raise KeyboardInterrupt
        join(thread, timeout)

    monkeypatch.setattr(Copy, "__init__", init)
    monkeypatch.setattr("threading.Thread.join", interrupted)
    sleeps = ("return x / 2", "return __import__('time').sleep(999)")
    endless = mistakes_of({"model/half.py": {"test_half.py": {"for ever": sleeps}}})
    with pytest.raises(KeyboardInterrupt):
        try_all(endless)
    (copy,) = copies
    assert copy._running is not None and copy._running.poll() is not None
    assert copy.run(["test_half.py"], 9.0) == (None, "stopped")
    assert not copy.folder.exists()
