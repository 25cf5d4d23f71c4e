"""A bar of progress beside what a command prints."""

from __future__ import annotations

from rich.console import Console
from rich.progress import Progress, ProgressColumn


class Bar(Progress):
    """On the standard error, gone when done; nothing unless `show`, or where that is no terminal: of a file it would leave an
    empty line."""

    def __init__(self, *columns: ProgressColumn, show: bool = True):
        console = Console(stderr=True)
        super().__init__(*columns, console=console, disable=not (show and console.is_interactive), transient=True)
