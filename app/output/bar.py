"""A progress bar next to the output of a command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import Progress, ProgressColumn, TaskID

LINE_SECONDS = 10.0  # between two lines if standard error is no terminal


class Bar(Progress):
    """A progress bar on standard error that vanishes when done; a line every LINE_SECONDS if that is no terminal;
    nothing unless `show`."""

    def __init__(self, columns: Sequence[ProgressColumn] = (), show: bool = True):
        console = Console(stderr=True)
        super().__init__(*columns, console=console, disable=not (show and console.is_interactive), transient=True)
        self._lines = show and not console.is_interactive
        self._next_line = monotonic() + LINE_SECONDS

    def update(self, task_id: TaskID, **fields: Any) -> None:
        """Update a task as `Progress.update` does; print a line if there is no bar."""
        super().update(task_id, **fields)
        if self._lines and monotonic() >= self._next_line:
            task = self._tasks[task_id]
            done = f": {task.completed:g}" if task.completed or task.total is not None else ""
            total = "" if task.total is None else f" of {task.total:g}"
            print(f"{task.description}{done}{total}", file=sys.stderr, flush=True)
            self._next_line = monotonic() + LINE_SECONDS
