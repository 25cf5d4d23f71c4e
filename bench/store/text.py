"""The text export of a store: CSV in sections.

A line `table:,column,column...` names the columns of the lines `table,value,value...` that
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
import zlib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from math import isfinite
from pathlib import Path
from typing import IO

from softlab.bench.store.schema import COLUMNS, TABLES, Description, Row, canonical, configuration_hash
from softlab.model.base.errors import InputError, shortened
from softlab.model.base.files import check_source

MAGIC = "softlab-results"
TEXT_VERSION = 1
TEXTS = (".csv", ".csv.gz")  # how the names of text exports end
DEEPEST = 32  # tables within tables that a column names
GROUP = ("configuration", "run", "sources", "stage", "steps", "suspect")  # what the repeats in one line share
Rows = dict[str, list[Row]]  # table -> rows in the column order of TABLES
READERS = {  # table -> of each column its name, its type, and whether an empty cell is none
    table: [
        (column, {"REAL": float, "INTEGER": int}.get(kind, str), not rule)
        for column, (kind, _, rule) in ((column, declared.partition(" ")) for column, declared in columns.items())
    ]
    for table, columns in COLUMNS.items()
}


def as_text(rows: Rows) -> str:
    """Return rows as text."""
    lines: list[list[str]] = [[MAGIC, str(TEXT_VERSION)], ["machine:", "key", "label", "field", "value"]]
    for key, label, record in rows["machine"]:
        for field, value in sorted(flatten(json.loads(record)).items()) or [("", "")]:
            lines.append(["machine", key, label, field, value])
    lines.append(["run:", *TABLES["run"]])
    lines += (["run", *map(_cell, row)] for row in rows["run"])
    flat = [(key, flatten(json.loads(description))) for key, description in rows["configuration"]]
    columns = sorted({column for _, cells in flat for column in cells})
    lines.append(["configuration:", "hash", *columns])
    lines += (["configuration", key, *(cells.get(column, "") for column in columns)] for key, cells in flat)
    lines.append(["sample:", *GROUP, "repeats", "seconds", "joules"])
    groups: dict[tuple[object, ...], list[tuple[int, float, float | None]]] = {}
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
    """Return a cell of CSV. (csv.writer does not quote a lone carriage return, which csv.reader takes for the end of
    the line.)"""
    return '"' + cell.replace('"', '""') + '"' if any(mark in cell for mark in ',"\r\n') else cell


def _cell(value: object) -> str:
    """Return a column of a table as text; None is empty (no column that may be None contains an empty text)."""
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def flatten(data: Mapping[str, object], prefix: str = "") -> dict[str, str]:
    """Return nested tables as {dotted path: cell}. A table that is empty, has keys with dots, or is nested deeper than
    DEEPEST stays one JSON cell."""
    cells: dict[str, str] = {}
    nests = prefix.count(".") < DEEPEST
    for key, value in data.items():
        if nests and isinstance(value, dict) and value and all(name and "." not in name for name in value):
            cells |= flatten(value, f"{prefix}{key}.")
        elif isinstance(value, str) and value and _value(value) == value:
            cells[prefix + key] = value
        else:
            cells[prefix + key] = json.dumps(value, sort_keys=True)
    return cells


@lru_cache(maxsize=65536)  # most cells of a column are the same
def _value(cell: str) -> object:
    """Value of a cell: JSON, or else its text."""
    try:
        return json.loads(cell)
    except ValueError:
        return cell


def is_text(file: str | Path) -> bool:
    """Return True for the name of a text export."""
    return str(file).lower().endswith(TEXTS)


def _opened(file: Path) -> IO[str]:
    opening = gzip.open if file.suffix.lower() == ".gz" else open
    return opening(file, "rt", encoding="utf-8", newline="")


def is_text_export(file: Path) -> bool:
    """Return True if a file begins like a text export."""
    try:
        with _opened(file) as opened:
            return opened.read(len(MAGIC) + 1) == MAGIC + ","
    except (OSError, EOFError, zlib.error, UnicodeDecodeError):
        return False


def unflatten(cells: Mapping[str, str]) -> Description:
    data: Description = {}
    for path, cell in cells.items():
        *parents, key = path.split(".")
        table = data
        for parent in parents:
            table = table.setdefault(parent, {})
        table[key] = _value(cell)
    return data


def read_text(file: Path) -> Rows:
    """Return the rows of a text export. Raises InputError with the line of the error."""
    check_source(file, "a text export is a .csv or .csv.gz file that softlab export wrote")
    try:
        with _opened(file) as opened:
            reader = csv.reader(opened, strict=True)
            try:
                return _parse(reader, file)
            except (
                ValueError, LookupError, AttributeError, TypeError, RecursionError, csv.Error, EOFError, zlib.error,
            ) as error:  # fmt: skip
                raise InputError(
                    f"{file}, line {reader.line_num}: not a line of a text export ({error}); export it again"
                ) from None
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}; check the path") from None


def _parse(reader: Iterator[list[str]], file: Path) -> Rows:
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
            description = unflatten({path: cell for path, cell in row.items() if cell})
            if configuration_hash(description) != key:
                raise ValueError(f"configuration {key} was changed")
            rows[table].append((key, canonical(description)))
        elif table == "sample":
            rows[table] += _samples(row)
        else:
            rows[table].append(_row(table, row))
    rows["machine"] = [(key, label, canonical(unflatten(cells))) for (key, label), cells in records.items()]
    return rows


def _row(table: str, cells: Mapping[str, str]) -> Row:
    """Return a row of a table from its cells, by column."""
    return tuple([None if not cells[name] and free else kind(cells[name]) for name, kind, free in READERS[table]])


def _samples(row: Mapping[str, str]) -> list[Row]:
    repeats, seconds = row["repeats"].split(), row["seconds"].split()
    joules = ["" if joule == "-" else joule for joule in row["joules"].split()] or [""] * len(repeats)
    for text in seconds:
        if not (isfinite(float(text)) and float(text) >= 0):
            raise ValueError(f"a sample took {shortened(text, 40)} s")
    return [
        _row("sample", {**row, "repeat": repeat, "seconds": second, "joules": joule})
        for repeat, second, joule in zip(repeats, seconds, joules, strict=True)
    ]
