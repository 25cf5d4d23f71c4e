"""The SQLite store: machines, runs, configurations, samples and measures (tables: bench/store/schema.py).

It contains raw repeats only; every summary is a query (bench/store/results.py). A finished sample is committed at once,
so that Ctrl-C or `kill -9` loses none.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from softlab.bench.store import schema
from softlab.bench.store.machine_records import gained
from softlab.bench.store.schema import (
    SCHEMA,
    SCHEMA_VERSION,
    Description,
    Row,
    canonical,
    check_rows,
    configuration_hash,
)
from softlab.model.base.errors import InputError
from softlab.model.base.files import check_source

DEFAULT_PATH = Path("softlab-results") / "results.sqlite"
BUSY_SECONDS = 5.0  # how long to wait for another process's write


class Store:
    """One store, open for reading and writing; a context manager.

    `path` is created with the first write (its folder only for the default path). `journal`: SQLite's journal mode;
    DELETE for a file that another host may read later, since WAL needs shared memory. Raises InputError, with what to
    do, for a store that is locked, damaged, no SQLite file, of another schema version, or that cannot be written;
    nothing on disk is changed then.
    """

    def __init__(
        self,
        path: str | Path = DEFAULT_PATH,
        *,
        readonly: bool = False,
        busy_seconds: float = BUSY_SECONDS,
        journal: str = "WAL",
    ):
        self.path, self.journal = str(path), journal
        self.readonly = readonly
        self._busy_seconds = busy_seconds
        memory = self.path == ":memory:"
        self.new = not memory and not self._is_store(Path(path))  # a file that the first thing written makes
        self.connection = self._opened(memory or self.new)

    def _opened(self, memory: bool) -> sqlite3.Connection:
        """A connection to the store's file, or to a store in main memory, with all tables."""
        # SQLite's own way of reading only would leave its -wal and -shm files behind, as it may not delete them
        mode = "?mode=rw" if self.readonly else "?mode=rwc"
        target = ":memory:" if memory else Path(self.path).absolute().as_uri() + mode
        with self._explained():
            connection = sqlite3.connect(target, uri=not memory, timeout=self._busy_seconds, isolation_level=None)
            try:
                self._prepare(connection, memory)
            except BaseException:
                connection.close()
                raise
        return connection

    def _is_store(self, file: Path) -> bool:
        """Return True if the file exists; refuse a file that cannot be a store before SQLite touches it."""
        try:
            if file.is_dir():
                raise InputError(f"{file} is a folder; the store is a file, such as {DEFAULT_PATH}")
            if file.exists():
                with check_source(file, f"the store is a file, such as {DEFAULT_PATH}").open("rb") as opened:
                    head = opened.read(16)
                if head and head != b"SQLite format 3\0":
                    raise InputError(f"{file} is neither a store nor a .csv export of one; give another path")
                return True
            if self.readonly:
                raise InputError(f"{file}: no such store; measure first (softlab sweep), or give another path")
            folder = Path() if file == DEFAULT_PATH and not file.parent.exists() else file.parent
            if not folder.is_dir():
                raise InputError(f"{folder}: no such folder; make it first, or give another path for the store")
            if not os.access(folder, os.W_OK):
                raise InputError(f"{file} cannot be made: its folder cannot be written; check the permissions")
        except OSError as error:
            raise InputError(f"{file} cannot be used: {error.strerror or error}; check its permissions") from None
        return False

    def _make(self) -> None:
        """Create the file, now that there is something to write; refused requests have created none."""
        file = Path(self.path)
        if file == DEFAULT_PATH:
            try:
                file.parent.mkdir(exist_ok=True)
            except OSError as error:
                raise InputError(f"{file.parent} cannot be made: {error.strerror or error}") from None
        connection = self._opened(False)
        self.connection.close()
        self.connection, self.new = connection, False

    def _prepare(self, connection: sqlite3.Connection, memory: bool) -> None:
        """Check before anything is written, then make the tables of a new store, in one transaction."""
        connection.execute(f"PRAGMA query_only = {'ON' if self.readonly else 'OFF'}")
        connection.execute("PRAGMA foreign_keys = ON")
        names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if names and "schema_version" not in names:
            raise InputError(f"{self.path} is a SQLite file, but no store of this lab; give another path")
        if not names:
            if self.readonly:
                raise InputError(f"{self.path} is empty; measure first (softlab sweep), or give another path")
            connection.execute("BEGIN IMMEDIATE")
            try:  # another process may have made them since
                if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
                    for statement in SCHEMA:
                        connection.execute(statement)
                connection.execute("COMMIT")
            except BaseException:
                connection.execute("ROLLBACK")
                raise
        (version,) = connection.execute("SELECT version FROM schema_version").fetchone() or (None,)
        if version != SCHEMA_VERSION:
            raise InputError(
                f"{self.path} has schema version {version}, this lab reads version {SCHEMA_VERSION}; export it to .csv "
                "with the lab that wrote it and merge that, or give another path"
            )
        (finding,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        if finding != "ok":
            raise sqlite3.DatabaseError(finding)
        if not memory:
            check_rows(connection, self.path)
        if not self.readonly and not memory:
            connection.execute(f"PRAGMA journal_mode = {self.journal}")
            connection.execute("PRAGMA synchronous = NORMAL")  # safe under kill -9, if not a power cut

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise InputError with a remedy for an error of SQLite."""
        try:
            yield
        except sqlite3.IntegrityError:
            raise  # a mistake of the caller, not of the file
        except sqlite3.DatabaseError as error:
            text = str(error)
            if "locked" in text or "busy" in text:
                remedy = "another process is using it; wait for it to end, or give another path"
            elif "readonly" in text or "unable to open" in text:
                remedy = "the file or its folder cannot be written; check the permissions, or give another path"
            elif "full" in text:
                remedy = "the disk is full; free some space, then run the same command again to resume"
            else:
                remedy = "the store is damaged; move it away (or restore a copy) and merge its last export"
            raise InputError(f"{self.path}: {text}: {remedy}") from None
        except UnicodeDecodeError:
            raise InputError(
                f"{self.path}: contains invalid text: the store is damaged; move it away (or restore a copy)"
            ) from None

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Store everything written inside this context, or nothing. A transaction inside another joins it."""
        if self.new:
            self._make()
        with self._explained():
            if self.connection.in_transaction:
                yield self.connection
                return
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield self.connection
                self.connection.execute("COMMIT")
            except BaseException:
                with suppress(sqlite3.Error):
                    self.connection.execute("ROLLBACK")
                raise

    def query(self, sql: str, arguments: tuple[object, ...] | Mapping[str, object] = ()) -> list[Row]:
        """Return the rows of a SELECT."""
        with self._explained():
            return self.connection.execute(sql, arguments).fetchall()

    def close(self) -> None:
        """Close the store; everything added is already on disk."""
        self.connection.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ writing

    def add_machine(self, key: str, label: str, record: Mapping[str, object]) -> None:
        """Add a machine. If it exists, only missing or null fields of its record are added, and undisturbed limits
        replace disturbed ones."""
        with self.transaction() as connection:
            known = connection.execute("SELECT record FROM machine WHERE key = ?", (key,)).fetchone()
            if known is None:
                connection.execute("INSERT INTO machine VALUES (?, ?, ?)", (key, label, canonical(record)))
                return
            old = json.loads(known[0])
            merged = gained(old, record)
            if merged != old:
                connection.execute("UPDATE machine SET record = ? WHERE key = ?", (canonical(merged), key))

    def start_run(self, machine: str, command: str, commit: str | None = None) -> str:
        """Add a run on a known machine and return its key; `commit` is the source revision, if known."""
        key = uuid.uuid4().hex[:12]
        started = datetime.now(UTC).isoformat(timespec="seconds")
        with self.transaction() as connection:
            connection.execute("INSERT INTO run VALUES (?, ?, ?, ?, ?)", (key, machine, commit, started, command))
        return key

    def add_configuration(self, description: Description) -> str:
        """Enter a configuration where it is new, and return its hash."""
        key = configuration_hash(description)
        with self.transaction() as connection:
            connection.execute("INSERT OR IGNORE INTO configuration VALUES (?, ?)", (key, canonical(description)))
        return key

    def add_sample(
        self,
        run: str,
        description: Description,
        sources: str,
        seconds: float,
        steps: int,
        *,
        stage: str = "step",
        joules: float | None = None,
        suspect: str | None = None,
    ) -> int:
        """Store one finished sample: `steps` steps took `seconds` [s]. On disk when this returns.

        Returns its repeat, counted over all runs of this configuration, machine, sources and stage.
        """
        if not (math.isfinite(seconds) and seconds >= 0):
            raise ValueError(f"a sample's seconds must be finite and not negative, not {seconds}")
        with self.transaction() as connection:
            key = self.add_configuration(description)
            (repeat,) = connection.execute(
                "SELECT coalesce(max(repeat) + 1, 0) FROM sample JOIN run ON run.key = sample.run "
                "WHERE configuration = ? AND sources = ? AND stage = ? "
                "AND machine = (SELECT machine FROM run WHERE key = ?)",
                (key, sources, stage, run),
            ).fetchone()
            connection.execute(
                "INSERT INTO sample VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (key, run, sources, stage, repeat, float(seconds), int(steps), joules, suspect or None),
            )
        return repeat

    def add_measure(
        self,
        run: str,
        description: Description,
        sources: str,
        name: str,
        value: float | None,
        unit: str = "",
        reason: str | None = None,
    ) -> None:
        """Store one measured number (error, growth, drift, valid ...); within a run the last one of a name holds.

        `value` None (or NaN) means there is none, and then `reason` says why; infinite is a value (error of a diverged
        run). With a value, `reason` is a note on how it was had.
        """
        if value is not None and math.isnan(value):
            value = None
        if value is None and not reason:
            raise ValueError(f"measure {name}: a missing value needs its reason")
        with self.transaction() as connection:
            key = self.add_configuration(description)
            connection.execute(
                "INSERT OR REPLACE INTO measure VALUES (?, ?, ?, ?, ?, ?, ?)",
                (key, run, sources, name, None if value is None else float(value), unit, reason or None),
            )

    # ------------------------------------------------------------------ resuming

    def sample_count(self, description: Description, machine: str, sources: str, stage: str = "step") -> int:
        """Number of samples in the store of this configuration, on this machine, of these sources."""
        return self.query(
            "SELECT count(*) FROM sample JOIN run ON run.key = sample.run "
            f"WHERE configuration = :configuration AND machine = :machine AND {schema.SOURCES} AND stage = :stage",
            schema.measured_as(description, machine, sources) | {"stage": stage},
        )[0][0]

    def has_measure(self, description: Description, machine: str, sources: str, name: str) -> bool:
        """Return True if the store has this measure of this configuration, on this machine, of these sources."""
        return bool(
            self.query(
                "SELECT 1 FROM measure JOIN run ON run.key = measure.run "
                f"WHERE configuration = :configuration AND machine = :machine AND {schema.SOURCES} AND name = :name LIMIT 1",
                schema.measured_as(description, machine, sources) | {"name": name},
            )
        )
