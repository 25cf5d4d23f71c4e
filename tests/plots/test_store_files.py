"""Files of a store: missing, damaged, locked, of another version; text exports that were damaged."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import pytest
from test_results import content, filled

from softlab.bench.store.database import Store
from softlab.bench.store.results import open_readonly, timings
from softlab.bench.store.schema import SCHEMA_VERSION
from softlab.bench.store.transfer import export, merge
from softlab.model.base.errors import InputError

# ---------------------------------------------------------------------- what may be wrong with a file


def test_a_store_in_a_folder_that_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        Store(tmp_path / "nowhere" / "results.sqlite")
    assert not (tmp_path / "nowhere").exists()


def test_the_default_folder_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Store() as opened:
        assert not list(tmp_path.iterdir())  # what is refused before anything is measured leaves nothing
        opened.add_machine("m", "a machine", {})
    assert (tmp_path / "softlab-results" / "results.sqlite").exists()


def test_reading_a_store_that_does_not_exist_makes_none(tmp_path: Path) -> None:
    for name in ("none.sqlite", "none.csv"):
        with pytest.raises(InputError):
            open_readonly(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_reading_a_store_leaves_nothing_beside_it_and_writes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "results.sqlite"
    with filled(file) as written:
        held = content(written)
    with open_readonly(file) as opened:
        assert content(opened) == held
        with pytest.raises(InputError, match="readonly"):
            opened.add_machine("m2", "another", {})
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of a POSIX system")
def test_a_pipe_is_no_export(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with filled() as store, pytest.raises(InputError, match="pipe or a device"):
        export(store, tmp_path / "pipe.csv")


@pytest.mark.parametrize("data", [b"not a database, just text", b"SQLite format 3\0" + b"\x07" * 4096])
def test_a_file_that_is_no_store_is_left_alone(tmp_path: Path, data: bytes) -> None:
    file = tmp_path / "results.sqlite"
    file.write_bytes(data)
    with pytest.raises(InputError, match=r"neither a store nor|damaged"):
        Store(file)
    assert file.read_bytes() == data


def test_a_damaged_store_is_said_to_be_and_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "results.sqlite"
    filled(file).close()
    data = bytearray(file.read_bytes())
    data[4096:] = b"\x55" * (len(data) - 4096)
    file.write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        Store(file)
    assert file.read_bytes() == data


def test_a_database_of_something_else_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "other.sqlite"
    with sqlite3.connect(file) as other:
        other.execute("CREATE TABLE recipes (name TEXT)")
    other.close()
    data = file.read_bytes()
    with pytest.raises(InputError, match="no store of this lab"):
        Store(file)
    assert file.read_bytes() == data


def test_a_store_of_another_version(tmp_path: Path) -> None:
    file = tmp_path / "results.sqlite"
    store = filled(file)
    store.connection.execute("UPDATE schema_version SET version = ?", (SCHEMA_VERSION + 1,))
    store.close()
    for readonly in (False, True):
        with pytest.raises(InputError, match=f"schema version {SCHEMA_VERSION + 1}"):
            Store(file, readonly=readonly)


def test_a_locked_store(tmp_path: Path) -> None:
    file = tmp_path / "results.sqlite"
    filled(file).close()
    holder = sqlite3.connect(file, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    try:
        with Store(file, busy_seconds=0.05) as store:  # it can be read ...
            assert len(timings(store)) == 2
            with pytest.raises(InputError, match="another process"):  # ... not written
                store.start_run("m1", "x")
        holder.execute("COMMIT")
        holder.execute("PRAGMA locking_mode = EXCLUSIVE")
        holder.execute("BEGIN EXCLUSIVE")
        holder.execute("UPDATE run SET command = command")
        holder.execute("COMMIT")
        with pytest.raises(InputError, match="another process"):
            Store(file, busy_seconds=0.05)
    finally:
        holder.close()
    with Store(file) as store:
        assert len(timings(store)) == 2


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(InputError, match="cannot be written"):
            Store(tmp_path / "results.sqlite")
    finally:
        tmp_path.chmod(0o700)


def test_a_failed_transaction_leaves_nothing(tmp_path: Path) -> None:
    with filled(tmp_path / "results.sqlite") as store:
        before = content(store)
        with pytest.raises(KeyboardInterrupt), store.transaction():
            store.start_run("m1", "interrupted")
            raise KeyboardInterrupt
        assert content(store) == before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("softlab-results,1", "softlab-results,9", "text version"),
        ("softlab-results,1", "rows,columns", "not a text export"),
        ("top-corners", "top", "was changed"),
        ("abc123+", "abc123+,more", "line"),
        ("0.1 0.3", "0.1", "line"),
        ("0.1 0.3", "0.1 fast", "line"),
        ("copy_bandwidth,6666666666.666667", "copy_bandwidth,banana", "copy_bandwidth"),
    ],
)
def test_a_text_export_that_was_damaged_changes_nothing(tmp_path: Path, old: str, new: str, message: str) -> None:
    with filled() as store, Store(":memory:") as target:
        file = export(store, tmp_path / "out.csv")
        good = file.read_text(encoding="utf-8")
        assert old in good
        file.write_text(good.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            merge(target, file)
        assert not any(content(target).values())


def test_an_export_overwrites_only_a_text_export(tmp_path: Path) -> None:
    (tmp_path / "thesis.csv").write_text("a,b\n1,2\n")
    with filled(tmp_path / "results.sqlite") as store:
        for name in ("thesis.csv", "results.sqlite"):
            with pytest.raises(InputError, match="would be overwritten"):
                export(store, tmp_path / name)
        with pytest.raises(InputError, match=r"\.csv or \.csv\.gz or \.sqlite"):
            export(store, tmp_path / "out.xlsx")
        with pytest.raises(InputError, match="does not exist"):
            export(store, tmp_path / "nowhere" / "out.csv")
        assert len(timings(store)) == 2
    assert (tmp_path / "thesis.csv").read_text() == "a,b\n1,2\n"
