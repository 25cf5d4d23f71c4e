"""Stores in and out: a text export that can be read, compared and committed, and merging.

The text is CSV in sections. A line `table:,column,column...` names the columns of the lines `table,value,value...` that
follow it. Descriptions and machine records are spread over columns by dotted path (`scene.grid.rows`); repeats of one
configuration share a line. Numbers are written so that they read back bit for bit. A name that ends in .csv.gz has the same
text compressed, the same bytes for the same text.

    softlab-results,1
    machine:,key,label,field,value               one line a field of the record
    run:,key,machine,commit_hash,started,command
    configuration:,hash,backend,graphics,...      an empty cell: the key is absent
    sample:,configuration,run,sources,stage,steps,suspect,repeats,seconds,joules     (lists, separated by spaces)
    measure:,configuration,run,sources,name,value,unit,reason
"""

from __future__ import annotations

import csv
import gzip
import json
import sqlite3
import zlib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import IO, Any

from bench.store.database import Store
from bench.store.schema import COLUMNS, TABLES, canonical, configuration_hash
from model.core.errors import InputError, shortened
from model.core.files import check_source, check_target, replacing

MAGIC = "softlab-results"
TEXT_VERSION = 1
TEXTS = (".csv", ".csv.gz")  # how the names of text exports end
DEEPEST = 32  # tables within tables that a column names
GROUP = ("configuration", "run", "sources", "stage", "steps", "suspect")  # what the repeats in one line share
Rows = dict[str, list[tuple[Any, ...]]]  # table -> rows in the column order of TABLES


def export(store: Store, path: str | Path, machine: str | None = None, after: int = 0) -> Path:
    """Write the store (or one machine's part of it, by key) to a .csv, .csv.gz or .sqlite file; the path. `after`: only runs
    that were entered after so many (`last_run`).

    An earlier text export is replaced, at once and whole; any other existing file is not. Raises InputError.
    """
    file = Path(path)
    check_target(file, (*TEXTS, ".sqlite"), "an export")
    if file.exists() and not (is_text(file) and _is_text_export(file)):
        raise InputError(f"{file} exists and would be overwritten; delete it first, or give another path")
    rows = _rows_of(store, machine, after)
    with replacing(file) as temporary:
        if is_text(file):
            text = _text(rows).encode()
            temporary.write_bytes(gzip.compress(text, mtime=0) if file.suffix == ".gz" else text)
        else:
            with Store(temporary) as target:
                _insert(target, rows, store.path)
                target.connection.execute("PRAGMA journal_mode = DELETE")  # one file, without its -wal beside it
    return file


def merge(store: Store, other: str | Path) -> dict[str, int]:
    """Take over what another store or text export holds; how many rows of each table were new.

    All or nothing; merging twice adds nothing. Raises InputError for a file that is neither.
    """
    file = Path(other)
    if is_text(file):
        rows = _read_text(file)
    else:
        with Store(file, readonly=True) as source:
            rows = _rows_of(source)
    if store.new:  # what does not fit together must not leave an empty store
        with Store(":memory:") as trial:
            _insert(trial, rows, file)
    return _insert(store, rows, file)


def load_text(paths: Iterable[str | Path]) -> Store:
    """An in-memory store of what the text exports hold, such as those in labbook/data/. Raises InputError."""
    store = Store(":memory:")
    for path in paths:
        _insert(store, _read_text(Path(path)), path)
    return store


def last_run(store: Store) -> int:
    """The number of the run that was entered last; 0: none."""
    return int(store.query("SELECT coalesce(max(rowid), 0) FROM run")[0][0])


def _rows_of(store: Store, machine: str | None = None, after: int = 0) -> Rows:
    """Every row of the store, or those of one machine or of runs `after` a number, in a repeatable order."""
    if machine is not None and not store.query("SELECT 1 FROM machine WHERE key = ?", (machine,)):
        known = ", ".join(key for (key,) in store.query("SELECT key FROM machine ORDER BY key"))
        raise InputError(f"{store.path} knows no machine {machine}; it knows: {known or 'none'}")
    mine = "SELECT key FROM run WHERE (:machine IS NULL OR machine = :machine) AND rowid > :after"
    used = f"SELECT configuration FROM {{}} WHERE run IN ({mine})"
    conditions = {
        "machine": "WHERE :machine IS NULL OR key = :machine ORDER BY key",
        "run": f"WHERE key IN ({mine}) ORDER BY started, key",
        "configuration": "WHERE (:machine IS NULL AND NOT :after) "
        f"OR hash IN ({used.format('sample')} UNION {used.format('measure')}) ORDER BY hash",
        "sample": f"WHERE run IN ({mine}) ORDER BY configuration, run, sources, stage, repeat",
        "measure": f"WHERE run IN ({mine}) ORDER BY configuration, run, sources, name",
    }
    wanted = {"machine": machine, "after": after}
    return {
        table: store.query(f"SELECT {', '.join(columns)} FROM {table} {conditions[table]}", wanted)
        for table, columns in TABLES.items()
    }


def _insert(store: Store, rows: Rows, origin: str | Path) -> dict[str, int]:
    """How many of the rows of `origin` were new in each table. Raises InputError."""
    added = dict.fromkeys(TABLES, 0)
    try:
        with store.transaction() as connection:
            for key, label, record in rows["machine"]:
                added["machine"] += not connection.execute("SELECT 1 FROM machine WHERE key = ?", (key,)).fetchone()
                store.add_machine(key, label, json.loads(record))
            for table in ("run", "configuration", "sample", "measure"):
                marks = ", ".join("?" * len(TABLES[table]))
                before = connection.total_changes
                connection.executemany(f"INSERT INTO {table} VALUES ({marks}) ON CONFLICT DO NOTHING", rows[table])
                added[table] = connection.total_changes - before
    except (sqlite3.IntegrityError, OverflowError) as error:
        raise InputError(
            f"{origin}: the results do not fit together ({error}); nothing was taken; export them anew"
        ) from None
    return added


# ---------------------------------------------------------------------- writing text


def _text(rows: Rows) -> str:
    lines: list[list[str]] = [[MAGIC, str(TEXT_VERSION)], ["machine:", "key", "label", "field", "value"]]
    for key, label, record in rows["machine"]:
        for field, value in sorted(_flatten(json.loads(record)).items()) or [("", "")]:
            lines.append(["machine", key, label, field, value])
    lines.append(["run:", *TABLES["run"]])
    lines += (["run", *map(_cell, row)] for row in rows["run"])
    flat = [(key, _flatten(json.loads(description))) for key, description in rows["configuration"]]
    columns = sorted({column for _, cells in flat for column in cells})
    lines.append(["configuration:", "hash", *columns])
    lines += (["configuration", key, *(cells.get(column, "") for column in columns)] for key, cells in flat)
    lines.append(["sample:", *GROUP, "repeats", "seconds", "joules"])
    groups: dict[tuple[Any, ...], list[tuple[int, float, float | None]]] = {}
    for key, run, sources, stage, repeat, seconds, steps, joules, suspect in rows["sample"]:
        groups.setdefault((key, run, sources, stage, steps, suspect), []).append((repeat, seconds, joules))
    for group, samples in groups.items():
        repeats, times, energies = (
            " ".join("-" if value is None else repr(value) for value in column) for column in zip(*samples, strict=True)
        )
        lines.append(["sample", *map(_cell, group), repeats, times, energies if energies.strip("- ") else ""])
    lines.append(["measure:", *TABLES["measure"]])
    lines += (["measure", *map(_cell, row)] for row in rows["measure"])
    return "".join(",".join(map(_quoted, line)) + "\n" for line in lines)


def _quoted(cell: str) -> str:
    """A cell of CSV. (csv.writer leaves a lone carriage return bare, which csv.reader takes for the line's end.)"""
    return '"' + cell.replace('"', '""') + '"' if any(mark in cell for mark in ',"\r\n') else cell


def _cell(value: Any) -> str:
    """A column of a table; None is empty (no column that may be None holds an empty text)."""
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def _flatten(data: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Nested tables as {dotted path: cell}. A table whose keys hold dots, that has none or lies DEEPEST within others stays
    one JSON cell."""
    cells: dict[str, str] = {}
    nests = prefix.count(".") < DEEPEST
    for key, value in data.items():
        if nests and isinstance(value, dict) and value and all(name and "." not in name for name in value):
            cells |= _flatten(value, f"{prefix}{key}.")
        elif isinstance(value, str) and value and _value(value) == value:
            cells[prefix + key] = value
        else:
            cells[prefix + key] = json.dumps(value, sort_keys=True)
    return cells


@lru_cache(maxsize=4096)  # most cells of a column are the same
def _value(cell: str) -> Any:
    """What a cell says: JSON, or else its text."""
    try:
        return json.loads(cell)
    except ValueError:
        return cell


# ---------------------------------------------------------------------- reading text


def is_text(file: str | Path) -> bool:
    """Whether a file's name is that of a text export."""
    return str(file).lower().endswith(TEXTS)


def _opened(file: Path) -> IO[str]:
    opening = gzip.open if file.suffix.lower() == ".gz" else open
    return opening(file, "rt", encoding="utf-8", newline="")


def _is_text_export(file: Path) -> bool:
    try:
        with _opened(file) as opened:
            return opened.read(len(MAGIC) + 1) == MAGIC + ","
    except (OSError, EOFError, zlib.error, UnicodeDecodeError):
        return False


def _unflatten(cells: Mapping[str, str]) -> dict[str, Any]:
    data: dict[str, Any] = {}
    for path, cell in cells.items():
        *parents, key = path.split(".")
        table = data
        for parent in parents:
            table = table.setdefault(parent, {})
        table[key] = _value(cell)
    return data


def _read_text(file: Path) -> Rows:
    """The rows of a text export. Raises InputError with the line that is wrong."""
    check_source(file, "a text export is a .csv or .csv.gz file")
    try:
        with _opened(file) as opened:
            reader = csv.reader(opened, strict=True)
            try:
                return _parse(reader, file)
            except (
                ValueError, LookupError, AttributeError, TypeError, RecursionError, csv.Error, EOFError, zlib.error,
            ) as error:  # fmt: skip
                raise InputError(
                    f"{file}, line {reader.line_num}: not a line of a text export ({error}); export it anew"
                ) from None
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}; check the path") from None


def _parse(reader: Any, file: Path) -> Rows:
    first: list[str] = next(reader, [])
    if not first or first[0] != MAGIC:
        raise InputError(f"{file} is not a text export of this lab (its first line is not {MAGIC})")
    if first[1:] != [str(TEXT_VERSION)]:
        raise InputError(f"{file} has text version {','.join(first[1:])}, this lab reads version {TEXT_VERSION}")
    rows: Rows = {table: [] for table in TABLES}
    records: dict[tuple[str, str], dict[str, str]] = {}
    columns: dict[str, list[str]] = {}
    for table, *cells in reader:
        if table.endswith(":"):
            columns[table[:-1]] = cells
            continue
        if len(cells) != len(columns[table]):
            raise ValueError(f"{len(cells)} cells, {len(columns[table])} columns")
        row = dict(zip(columns[table], cells, strict=True))
        if table == "machine":
            record = records.setdefault((row["key"], row["label"]), {})
            if row["field"]:
                record[row["field"]] = row["value"]
        elif table == "configuration":
            key = row.pop("hash")
            description = _unflatten({path: cell for path, cell in row.items() if cell})
            if configuration_hash(description) != key:
                raise ValueError(f"configuration {key} was changed")
            rows[table].append((key, canonical(description)))
        elif table == "sample":
            rows[table] += _samples(row)
        else:
            rows[table].append(_row(table, row))
    rows["machine"] = [(key, label, canonical(_unflatten(cells))) for (key, label), cells in records.items()]
    return rows


def _row(table: str, cells: Mapping[str, str]) -> tuple[Any, ...]:
    """A row of a table from its cells, by column."""
    return tuple(_read(declared, cells[column]) for column, declared in COLUMNS[table].items())


def _read(declared: str, cell: str) -> Any:
    """A cell as its column declares it; an empty one is none where it may be."""
    kind, _, rule = declared.partition(" ")
    if not cell and not rule:
        return None
    return {"REAL": float, "INTEGER": int}.get(kind, str)(cell)


def _samples(row: Mapping[str, str]) -> list[tuple[Any, ...]]:
    repeats, seconds = row["repeats"].split(), row["seconds"].split()
    joules = ["" if joule == "-" else joule for joule in row["joules"].split()] or [""] * len(repeats)
    for text in seconds:
        if not (isfinite(float(text)) and float(text) >= 0):
            raise ValueError(f"a sample took {shortened(text, 40)} s")
    return [
        _row("sample", {**row, "repeat": repeat, "seconds": second, "joules": joule})
        for repeat, second, joule in zip(repeats, seconds, joules, strict=True)
    ]
