"""The commands on whole stores, one function per sub-command; softlab/cli.py adds them to its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from softlab.app.command.command_line import DEFAULT_STORE, StorePath, out

keeping = typer.Typer()


@keeping.command(epilog="Example: softlab export my-machine.csv")
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A new .csv or .sqlite file.")],
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Write the store to one file, to keep or to send."""
    from softlab.bench.store.database import Store
    from softlab.bench.store.transfer import export as export_store

    with Store(store, readonly=True) as opened:
        out.print(str(export_store(opened, file)), markup=False)


@keeping.command(epilog="Example: softlab merge other-machine.csv")
def merge(
    other: Annotated[Path, typer.Argument(metavar="FILE", help="A .csv or .sqlite file.")],
    store: StorePath = DEFAULT_STORE,
) -> None:
    """Take the measurements of another store into this one; doing it twice adds nothing."""
    from softlab.bench.store.database import Store
    from softlab.bench.store.transfer import merge as merge_store

    with Store(store) as opened:
        new = merge_store(opened, other)
    out.print(", ".join(f"{count} new in {table}" for table, count in new.items()))
