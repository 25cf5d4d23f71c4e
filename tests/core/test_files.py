"""Files that a user names: what is no file is not read, what is written is whole, and nothing stays behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from softlab.model.base.errors import LONGEST, InputError, SceneError, SoftlabError
from softlab.model.base.files import OLD_SECONDS, check_source, check_target, read_archive, read_text, replacing
from softlab.model.scene.reader import parse_settings, tables_of
from softlab.model.scene.scene import load_scene

DEEP = "[" * 5000 + "]" * 5000


def ended_process() -> int:
    """The number of a process that is no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no pipes with names")
@pytest.mark.parametrize(
    "read", [load_scene, lambda path: read_archive(path, "a state"), lambda path: read_text(path, "a text")]
)
def test_what_has_no_end_is_not_read(tmp_path: Path, read) -> None:
    """A pipe that nobody writes to would wait for ever, a device of zeros fill the memory."""
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "pipe-link.toml").symlink_to("pipe.toml")
    for name in ("pipe.toml", "pipe-link.toml", "loop.toml", "x" * 300, "x" * 300 + ".toml", "x" * 5000 + ".toml"):
        with pytest.raises(InputError) as refused:
            read(tmp_path / name)
        assert len(str(refused.value)) <= LONGEST
    for device in ("/dev/zero", "/dev/full", "/dev/null"):
        with pytest.raises(InputError, match="a pipe or a device"):
            read(device)


def test_a_text_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softlab.model.base.files.LONGEST_TEXT", 10)
    file = tmp_path / "some.toml"
    file.write_text("a" * 10)
    assert read_text(file, "a text") == "a" * 10
    file.write_text("a" * 11)
    with pytest.raises(InputError, match="longer than"):
        read_text(file, "a text")


def test_what_killed_processes_left_is_cleared(tmp_path: Path) -> None:
    """Of this file, by processes that are gone, or of long ago; what others write stays."""
    target, other = tmp_path / "state.npz", tmp_path / "state.b.npz"
    with replacing(target) as temporary:
        temporary.write_text("new")
        start, end = temporary.name.split(str(os.getpid()))
    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]
    dead, alive = ended_process(), os.getppid()
    with replacing(other) as temporary:
        strange = temporary.name.replace(str(os.getpid()), str(dead))
        temporary.write_text("other")
    left = [f"{start}{dead}{end}", f"{start}{dead}{end}-wal", f"{start}{alive}{end}", strange]
    for name in left:
        (tmp_path / name).write_text("half")
    with replacing(target) as temporary:
        temporary.write_text("newer")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*left[2:], "state.npz", "state.b.npz"])
    (old := tmp_path / left[2]).touch()
    os.utime(old, (1e9, 1e9))
    assert OLD_SECONDS < 1e9
    with replacing(target) as temporary:
        temporary.write_text("newest")
    assert not old.exists() and (tmp_path / strange).exists()


def test_nothing_is_written_through_the_link_of_another(tmp_path: Path) -> None:
    target, precious = tmp_path / "state.npz", tmp_path / "precious"
    precious.write_text("precious")
    with replacing(target) as temporary:
        name = temporary.name
    (tmp_path / name).symlink_to(precious)
    with replacing(target) as temporary:
        temporary.write_text("new")
    assert precious.read_text() == "precious" and target.read_text() == "new"


def test_names_too_long_to_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="too long"):
        check_target(tmp_path / ("x" * 300 + ".npz"), (".npz",))
    long = tmp_path / ("x" * 250 + ".npz")  # as long as file systems take: its hidden name is not longer
    with replacing(check_target(long, (".npz",))) as temporary:
        temporary.write_text("whole")
    assert long.read_text() == "whole"
    (tmp_path / "x.npz").mkdir()
    with pytest.raises(InputError, match="a folder"):
        check_target(tmp_path / "x.npz", (".npz",))
    with pytest.raises(InputError, match="is a directory; what it is"):
        check_source(tmp_path, "what it is")


@pytest.mark.parametrize(
    "text", [f"a = {DEEP}", f"a = {'{a=' * 3000}1{'}' * 3000}", "a = " + "9" * 5000, "a = -1" + "_0" * 5000],
    ids=["lists", "tables", "digits", "marked digits"],
)  # fmt: skip
def test_toml_that_python_cannot_take(tmp_path: Path, text: str) -> None:
    with pytest.raises(ValueError, match=r"nested too deep|thousands of digits \(at line 1\)"):
        tables_of(text)
    file = tmp_path / "deep.toml"
    file.write_text(f"\n{text}")
    with pytest.raises(InputError, match=r"is not TOML: .*(deep|line 2)"):
        load_scene(file)
    with pytest.raises(SceneError, match=r"--set grid\.rows = ") as refused:
        parse_settings([f"grid.rows={text.removeprefix('a = ')}"])
    assert len(str(refused.value)) <= LONGEST


def nested(depth: int) -> list:
    deep: list = []
    for _ in range(depth):
        deep = [deep]
    return deep


ODD = {
    "deep": nested(100_000),
    "long": 16**6000,
    "text": "x" * 10**6,
    "marks": ["\u202e\n"] * 5000,
    "table": {"a": nested(5000)},
}


@pytest.mark.parametrize("value", ODD.values(), ids=list(ODD))
@pytest.mark.parametrize("field", ["grid.rows", "x" * 20_000, "\n\x1b" * 5000], ids=["short", "long", "marks"])
def test_messages_end(field: str, value: object) -> None:
    """Whatever was given: one line, printable, with the field's begin and what is allowed."""
    told = str(SceneError(field, value, "must be a whole number"))
    assert len(told) <= LONGEST and told.isprintable()
    assert told.startswith(field[:9].encode("unicode_escape").decode()[:9])
    assert told.endswith("must be a whole number")


def test_a_long_message_keeps_its_ends() -> None:
    told = str(SoftlabError("begin " + "x" * 10_000 + " end"))
    assert len(told) <= LONGEST and told.startswith("begin x") and told.endswith("x end") and " ... " in told
