"""How long a measuring command took last time on this machine with these options: said before it starts, kept in its store.

A table of its own beside those of bench/store.py: it is about this machine alone, so it is neither exported nor merged.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from typer import Exit
from typer.core import TyperCommand

from app.command_line import errors
from bench.store import Store, canonical
from model.errors import SoftlabError

TABLE = """CREATE TABLE IF NOT EXISTS took (
    machine TEXT NOT NULL, command TEXT NOT NULL, seconds REAL NOT NULL, configurations INTEGER NOT NULL,
    PRIMARY KEY (machine, command))"""
INTERRUPTED = 130  # exit status


class Timed(TyperCommand):
    """A command with an option `store` that says first how long it took last time. What was stopped, or found everything
    measured, is not kept."""

    def invoke(self, ctx: Any) -> Any:
        usual = {parameter.name: parameter.default for parameter in self.params}
        options = {name: str(value) for name, value in ctx.params.items() if value != usual[name] and name != "store"}
        path, command = Path(ctx.params["store"]), canonical(options | {"command": self.name})
        errors.print(f"{self.name}: {last_time(path, command)}", markup=False)
        begin, before = time.perf_counter(), _runs(path)
        try:
            result = super().invoke(ctx)
        except Exit as stop:
            if stop.exit_code != INTERRUPTED:
                keep_time(path, command, time.perf_counter() - begin, before)
            raise
        keep_time(path, command, time.perf_counter() - begin, before)
        return result


def last_time(path: Path, command: str) -> str:
    """What is told of a command before it starts. What is wrong with the store the command itself will say."""
    told = "first time here with these options"
    with suppress(SoftlabError):
        if path.is_file():
            with Store(path, readonly=True) as store:
                if _has_table(store):
                    found = store.query(
                        "SELECT seconds, configurations FROM took WHERE machine = ? AND command = ?",
                        (_machine(), command),
                    )
                    for seconds, configurations in found:
                        told = f"took {seconds:.0f} s last time here, for {configurations} configurations measured anew"
    return told


def keep_time(path: Path, command: str, seconds: float, before: int) -> None:
    """Keep how long a command took that measured something: in runs after number `before` of the store."""
    if _runs(path) == before:
        return
    with suppress(SoftlabError), Store(path) as store:
        ((configurations,),) = store.query(
            "SELECT count(*) FROM (SELECT configuration FROM sample JOIN run ON key = run WHERE run.rowid > :before "
            "UNION SELECT configuration FROM measure JOIN run ON key = run WHERE run.rowid > :before)",
            {"before": before},
        )
        with store.transaction() as connection:
            connection.execute(TABLE)
            connection.execute(
                "INSERT OR REPLACE INTO took VALUES (?, ?, ?, ?)", (_machine(), command, seconds, configurations)
            )


def _runs(path: Path) -> int:
    """The number of the last run in a store; 0 where there is none."""
    with suppress(SoftlabError):
        if path.is_file():
            with Store(path, readonly=True) as store:
                return int(store.query("SELECT coalesce(max(rowid), 0) FROM run")[0][0])
    return 0


def _has_table(store: Store) -> bool:
    return bool(store.query("SELECT 1 FROM sqlite_master WHERE name = 'took'"))


def _machine() -> str:
    from bench.machine import machine_key, machine_record

    return machine_key(machine_record())
