"""Stores in and out: a text export that can be read, compared and committed (bench/store/text.py), and merging."""

from __future__ import annotations

import gzip
import json
import sqlite3
from collections.abc import Iterable
from pathlib import Path

from softlab.app.command.command_line import without_store
from softlab.bench.store.database import Store
from softlab.bench.store.schema import TABLES, checked_record
from softlab.bench.store.text import TEXTS, Rows, as_text, is_text, is_text_export, read_text
from softlab.model.base.errors import InputError
from softlab.model.base.files import check_target, replacing


def export(store: Store, path: str | Path, machine: str | None = None, after: int = 0) -> Path:
    """Write the store (or one machine's part of it, by key) to a .csv, .csv.gz or .sqlite file, and return its path. `after`:
    only runs after this number (`last_run`). Commands are written without --store and its path.

    An earlier text export is replaced, at once and whole; any other existing file is not. Raises InputError.
    """
    file = Path(path)
    check_target(file, (*TEXTS, ".sqlite"), "an export")
    if file.exists() and not (is_text(file) and is_text_export(file)):
        raise InputError(f"{file} exists and would be overwritten; delete it first, or give another path")
    rows = _without_paths(_rows_of(store, machine, after))
    with replacing(file) as temporary:
        if is_text(file):
            text = as_text(rows).encode()
            temporary.write_bytes(gzip.compress(text, mtime=0) if file.suffix == ".gz" else text)
        else:
            with Store(temporary) as target:
                _insert(target, rows, store.path)
                target.connection.execute("PRAGMA journal_mode = DELETE")  # one file, without its -wal beside it
    return file


def merge(store: Store, other: str | Path) -> dict[str, int]:
    """Merge another store or text export; return the number of new rows of each table.

    All or nothing; merging twice adds nothing. Raises InputError for a file that is neither.
    """
    file = Path(other)
    if is_text(file):
        rows = read_text(file)
    else:
        with Store(file, readonly=True) as source:
            rows = _rows_of(source)
    if store.new:  # what does not fit together must not leave an empty store
        with Store(":memory:") as trial:
            _insert(trial, rows, file)
    return _insert(store, rows, file)


def load_text(paths: Iterable[str | Path]) -> Store:
    """Return an in-memory store with the contents of text exports, such as labbook/data/. Raises InputError."""
    store = Store(":memory:")
    for path in paths:
        _insert(store, read_text(Path(path)), path)
    return store


def last_run(store: Store) -> int:
    """Return the number of the latest run; 0: none."""
    return int(store.query("SELECT coalesce(max(rowid), 0) FROM run")[0][0])


def _rows_of(store: Store, machine: str | None = None, after: int = 0) -> Rows:
    """Every row of the store, or those of one machine or of runs `after` a number, in a repeatable order."""
    if machine is not None and not store.query("SELECT 1 FROM machine WHERE key = ?", (machine,)):
        known = ", ".join(key for (key,) in store.query("SELECT key FROM machine ORDER BY key"))
        raise InputError(f"{store.path} knows no machine {machine}; it knows: {known or 'none'}")
    runs = "SELECT key FROM run WHERE (:machine IS NULL OR machine = :machine) AND rowid > :after"
    used = f"SELECT configuration FROM {{}} WHERE run IN ({runs})"
    conditions = {
        "machine": "WHERE :machine IS NULL OR key = :machine ORDER BY key",
        "run": f"WHERE key IN ({runs}) ORDER BY started, key",
        "configuration": "WHERE (:machine IS NULL AND NOT :after) "
        f"OR hash IN ({used.format('sample')} UNION {used.format('measure')}) ORDER BY hash",
        "sample": f"WHERE run IN ({runs}) ORDER BY configuration, run, sources, stage, repeat",
        "measure": f"WHERE run IN ({runs}) ORDER BY configuration, run, sources, name",
    }
    wanted = {"machine": machine, "after": after}
    return {
        table: store.query(f"SELECT {', '.join(columns)} FROM {table} {conditions[table]}", wanted)
        for table, columns in TABLES.items()
    }


def _without_paths(rows: Rows) -> Rows:
    """Return the rows without paths of stores in the commands of runs."""
    command = TABLES["run"].index("command")
    runs = [(*run[:command], without_store(run[command].split(" ")), *run[command + 1 :]) for run in rows["run"]]
    return rows | {"run": runs}


def _insert(store: Store, rows: Rows, origin: str | Path) -> dict[str, int]:
    """Insert the rows of `origin`; return the number of new ones in each table. Raises InputError."""
    added = dict.fromkeys(TABLES, 0)
    try:
        with store.transaction() as connection:
            for key, label, record in rows["machine"]:
                added["machine"] += not connection.execute("SELECT 1 FROM machine WHERE key = ?", (key,)).fetchone()
                store.add_machine(key, label, checked_record(json.loads(record)))
            for table in ("run", "configuration", "sample", "measure"):
                marks = ", ".join("?" * len(TABLES[table]))
                before = connection.total_changes
                connection.executemany(f"INSERT INTO {table} VALUES ({marks}) ON CONFLICT DO NOTHING", rows[table])
                added[table] = connection.total_changes - before
    except (sqlite3.IntegrityError, OverflowError, ValueError) as error:
        raise InputError(
            f"{origin}: the results are inconsistent ({error}); nothing was merged; export them again"
        ) from None
    return added
