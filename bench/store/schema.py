"""The tables of a store and their keys. All are keyed by text, so that two stores merge without renumbering:

    machine        key, label, record (JSON)
    run            key, machine, commit_hash, started (UTC, ISO 8601), command
    configuration  hash (of `description`), description (canonical JSON)
    sample         configuration, run, sources, stage, repeat, seconds, steps, joules, suspect
    measure        configuration, run, sources, name, value, unit, reason
    schema_version version

`sources` is a hash of the code that was measured: configuration + machine + sources is the key by which a sweep
resumes, or the sources that a measure `same_kernels` names beside them. `steps` are the steps in one sample, so that the
time of a step is a query; 0 for a stage without (compile).
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Mapping
from typing import Any

from softlab.model.base.errors import InputError, shown
from softlab.model.base.table import Table, Tables

SCHEMA_VERSION = 1
KEY, TEXT, INTEGER, REAL = "TEXT PRIMARY KEY", "TEXT NOT NULL", "INTEGER NOT NULL", "REAL NOT NULL"
OF = {name: f"TEXT NOT NULL REFERENCES {name}" for name in ("machine", "configuration", "run")}
COLUMNS = {  # table -> column -> its declaration, in the order of the text export
    "machine": {"key": KEY, "label": TEXT, "record": TEXT},
    "run": {"key": KEY, "machine": OF["machine"], "commit_hash": "TEXT", "started": TEXT, "command": TEXT},
    "configuration": {"hash": KEY, "description": TEXT},
    "sample": {
        "configuration": OF["configuration"], "run": OF["run"], "sources": TEXT, "stage": TEXT, "repeat": INTEGER,
        "seconds": REAL, "steps": INTEGER, "joules": "REAL", "suspect": "TEXT",
    },
    "measure": {
        "configuration": OF["configuration"], "run": OF["run"], "sources": TEXT, "name": TEXT, "value": "REAL",
        "unit": TEXT, "reason": "TEXT",
    },
}  # fmt: skip
KEYS = {"sample": "configuration, run, sources, stage, repeat", "measure": "configuration, run, sources, name"}
TABLES = {table: tuple(columns) for table, columns in COLUMNS.items()}
SAME = "same_kernels"  # a measure: its reason is other sources under which a configuration counts as measured
SOURCES = (  # those asked for, or others of the same kernels
    "(sources = :sources OR sources IN (SELECT reason FROM measure AS same WHERE same.configuration = :configuration "
    "AND same.sources = :sources AND same.name = :same))"
)
STORED = {"TEXT": ("text",), "INTEGER": ("integer",), "REAL": ("real", "integer")}  # as SQLite names what lies in them


def _create(table: str) -> str:
    columns = [f"{column} {declared}" for column, declared in COLUMNS[table].items()]
    key = [f"PRIMARY KEY ({KEYS[table]})"] if table in KEYS else []
    return f"CREATE TABLE {table} ({', '.join(columns + key)})"


Row = tuple[Any, ...]  # of a table, as SQLite has it: numbers, texts, None
Description = dict[str, Any]  # of a configuration, by which the store knows it: JSON values by name

SCHEMA = (  # statements that make the tables
    "CREATE TABLE schema_version (version INTEGER NOT NULL)",
    f"INSERT INTO schema_version VALUES ({SCHEMA_VERSION})",
    *map(_create, TABLES),
)


def canonical(description: Mapping[str, object]) -> str:
    """Return canonical JSON: equal texts mean equal descriptions."""
    return json.dumps(description, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def tables_by_kind(scene: Tables) -> dict[str, Table]:
    """Return the tables of a scene in a description by kind: `grid`, `method`."""
    return {table.get("kind", name): table for name, table in scene.items() if isinstance(table, dict)}


def configuration_hash(description: Description) -> str:
    """Return the 16 hexadecimal digits that identify a configuration."""
    return hashlib.sha256(canonical(description).encode()).hexdigest()[:16]


def measured_as(description: Description, machine: str, sources: str) -> dict[str, str]:
    """Arguments of a query with SOURCES."""
    return {"configuration": configuration_hash(description), "machine": machine, "sources": sources, "same": SAME}


def check_rows(connection: sqlite3.Connection, path: str) -> None:
    """Refuse rows with wrong types, since SQLite accepts any type in any column. Raises InputError."""
    damaged = "this lab wrote no such row; restore a copy, or merge its last export into another store"
    for table, columns in COLUMNS.items():
        for column, declared in columns.items():
            kind, _, rule = declared.partition(" ")
            types = STORED[kind] if rule else (*STORED[kind], "null")
            damage = connection.execute(
                f"SELECT rowid, {column} FROM {table} WHERE typeof({column}) NOT IN ({', '.join(map(repr, types))}) LIMIT 1"
            ).fetchone()
            if damage:
                raise InputError(f"{path}: {table}.{column} = {shown(damage[1])} in row {damage[0]}: {damaged}")
    for table, column in (("machine", "record"), ("configuration", "description")):
        for row, text in connection.execute(f"SELECT rowid, {column} FROM {table}"):
            try:
                good = isinstance(json.loads(text), dict)
            except (ValueError, RecursionError):
                good = False
            if not good:
                raise InputError(f"{path}: {table}.{column} = {shown(text)} in row {row}: {damaged}")


NUMBERS = (
    "copy_bandwidth", "copy_bytes", "cores", "gpu_copy_bandwidth", "gpu_count", "gpu_l2_bytes", "gpu_launch_seconds",
    "gpu_memory_gib", "gpu_multiprocessors", "memory_gib", "numba_threads",
)  # fmt: skip
TABLES_OF_NUMBERS = ("arithmetic", "caches", "gpu_arithmetic", "region_policies", "region_seconds")


def checked_record(record: Mapping[str, object]) -> Mapping[str, object]:
    """Return a machine's record after a check of its numbers. Raises ValueError, which names the field."""

    def check(name: str, value: object) -> None:
        number = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < float("inf")
        if value is not None and not number:
            raise ValueError(f"{name} = {value!r} is not a number of at least 0")

    def check_table(name: str, table: object) -> None:
        if table is not None and not isinstance(table, dict):
            raise ValueError(f"{name} = {table!r} is not a table of numbers")
        for key, value in table.items() if isinstance(table, dict) else ():
            (check_table if isinstance(value, dict) else check)(f"{name}.{key}", value)

    for name in NUMBERS:
        check(name, record.get(name))
    for name in TABLES_OF_NUMBERS:
        check_table(name, record.get(name))
    return record
