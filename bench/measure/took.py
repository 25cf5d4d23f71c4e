"""Duration of a measuring command last time on this machine with these options: printed before it starts, and stored.
The table is separate from those of bench/store/database.py, because it is about this machine only and is neither
exported nor merged.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from typer import Context, Exit
from typer.core import TyperCommand

from softlab.app.command.command_line import errors
from softlab.bench.store.database import Store
from softlab.bench.store.schema import canonical
from softlab.bench.store.versions import refuse_changed_files
from softlab.model.base.errors import SoftlabError

TABLE = """CREATE TABLE IF NOT EXISTS took (
    machine TEXT NOT NULL, command TEXT NOT NULL, seconds REAL NOT NULL, configurations INTEGER NOT NULL,
    PRIMARY KEY (machine, command))"""
INTERRUPTED = 130  # exit status
DIRTY = "allow_dirty"  # a parameter of softlab itself


def refuse_changes(context: Context) -> None:
    """Raise InputError if the lab's files differ from their commit, unless `softlab --allow-dirty` was given."""
    refuse_changed_files(bool(context.find_root().params.get(DIRTY)))


class Timed(TyperCommand):
    """A command with an option `store` that first prints its duration last time. Runs that were stopped or measured nothing
    are not stored. Without `softlab --allow-dirty` it measures no code that differs from its commit."""

    def invoke(self, ctx: Any) -> object:
        refuse_changes(ctx)
        usual = {parameter.name: parameter.default for parameter in self.params}
        options = {name: str(value) for name, value in ctx.params.items() if value != usual[name] and name != "store"}
        path, command = Path(ctx.params["store"]), canonical(options | {"command": self.name})
        message, before = last_duration(path, command)
        if message:
            errors.print(f"{self.name}: {message}", markup=False)
        begin = time.perf_counter()
        try:
            result = super().invoke(ctx)
        except Exit as stop:
            if stop.exit_code != INTERRUPTED:
                store_duration(path, command, time.perf_counter() - begin, before)
            raise
        store_duration(path, command, time.perf_counter() - begin, before)
        return result


def last_duration(path: Path, command: str) -> tuple[str, int]:
    """Return the message before a command starts (empty the first time) and the number of the last run in its store.

    Errors of the store are left to the command itself.
    """
    with suppress(SoftlabError, OSError, ValueError):  # among them names that no file can have
        if path.is_file():
            with Store(path, readonly=True) as store:
                last = int(store.query("SELECT coalesce(max(rowid), 0) FROM run")[0][0])
                if store.query("SELECT 1 FROM sqlite_master WHERE name = 'took'"):
                    rows = store.query(
                        "SELECT seconds, configurations FROM took WHERE machine = ? AND command = ?",
                        (_machine(), command),
                    )
                    for seconds, configurations in rows:
                        return (
                            f"took {seconds:.0f} s last time here, for {configurations} configurations measured",
                            last,
                        )
                return "", last
    return "", 0


def store_duration(path: Path, command: str, seconds: float, before: int) -> None:
    """Store the duration of a command that measured something: in runs after number `before` of the store."""
    with suppress(SoftlabError, OSError, ValueError):  # among them names that no file can have
        if not path.is_file():
            return
        with Store(path) as store, store.transaction() as connection:
            ((configurations,),) = connection.execute(
                "SELECT count(*) FROM (SELECT configuration FROM sample JOIN run ON key = run WHERE run.rowid > :before "
                "UNION SELECT configuration FROM measure JOIN run ON key = run WHERE run.rowid > :before)",
                {"before": before},
            )
            if configurations:
                connection.execute(TABLE)
                connection.execute(
                    "INSERT OR REPLACE INTO took VALUES (?, ?, ?, ?)", (_machine(), command, seconds, configurations)
                )


def _machine() -> str:
    from softlab.bench.measure.machine import machine_key, machine_record

    return machine_key(machine_record())
