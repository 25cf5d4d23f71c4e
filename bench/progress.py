"""The bar that every command shows which takes longer than a second."""

from __future__ import annotations

from typing import Any


def progress_bar(show: bool) -> Any:
    """A rich.progress.Progress on standard error, a context manager; it vanishes when done, and shows nothing unless
    `show`."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(None), TimeElapsedColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), disable=not show, transient=True)
