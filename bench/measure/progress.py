"""Progress bar of every command that takes longer than a second. For a command of several parts it also shows the progress
of the whole, by the duration of each part last time on this machine.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType

from rich.console import RenderableType
from rich.progress import BarColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from softlab.app.output.bar import Bar
from softlab.model.base.disk_cache import user_cache
from softlab.model.base.errors import InputError
from softlab.model.base.files import replacing
from softlab.model.base.kernel_cache import watched

SECONDS = "seconds.json"  # of the parts of each command, the last time


class Whole:
    """The parts of a running command. `expected`: seconds of each, in order; bars within `part` show the total
    progress, too."""

    current: Whole | None = None

    def __init__(self, name: str, expected: Mapping[str, float]):
        self.name, self.expected = name, dict(expected)
        self.begin = time.monotonic()
        self.seconds: dict[str, float] = {}  # of the parts that are done
        self.at = ""

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        begin = time.monotonic()
        self.at, Whole.current = name, self
        try:
            yield
        finally:
            Whole.current = None
        self.seconds[name] = time.monotonic() - begin

    def done(self, fraction: float) -> float:
        """Expected seconds that have passed, with `fraction` (0 to 1) of the part under way done."""
        return sum(self.expected[name] for name in self.seconds) + fraction * self.expected[self.at]

    def __str__(self) -> str:
        return f"{self.name}, {list(self.expected).index(self.at) + 1} of {len(self.expected)}: {self.at}"


class Bars(Bar):
    """Bar that also shows the progress of the whole command, and the kernel that is being compiled."""

    def __init__(self, show: bool):
        self.whole, self.whole_task = Whole.current, None  # first: `Progress` asks for what to show at once
        columns = (TextColumn("{task.description}"), BarColumn(None), TimeElapsedColumn(), TimeRemainingColumn())
        super().__init__(columns, show=show)
        self.watching = ExitStack()
        if self.whole:
            self.whole_task = super().add_task(str(self.whole), total=sum(self.whole.expected.values()) or 1)
            self.tasks[0].start_time = self.whole.begin

    def __enter__(self) -> Bars:
        self.watching.enter_context(watched(self.compiling))
        super().__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        self.watching.close()

    @property
    def inner(self) -> list[Task]:
        """The part's own tasks."""
        return [task for task in self.tasks if task.id != self.whole_task]

    def compiling(self, label: str, seconds: float | None) -> None:
        """Show that a kernel is being compiled, until the next description of progress."""
        last = "" if seconds is None else f", {seconds:.0f} s last time"
        for task in self.inner[-1:]:
            self.update(task.id, description=f"compiling {label}{last}")

    def get_renderables(self) -> Iterable[RenderableType]:
        if self.whole and self.whole_task is not None:
            fraction = self.inner[-1].percentage / 100 if self.inner else 0.0
            self.tasks[0].completed = self.whole.done(min(fraction, 1.0))
        return super().get_renderables()


def progress_bar(show: bool) -> Bars:
    """A context manager on standard error; it vanishes when done, and shows nothing unless `show`."""
    return Bars(show)


# ---------------------------------------------------------------------- how long it took last time


def last_seconds(command: str) -> dict[str, float]:
    """Return the seconds of the command's parts when it last ran to its end here, or nothing if unknown."""
    folder = user_cache("times")
    with suppress(OSError, ValueError, AttributeError, TypeError):
        stored = json.loads((folder / SECONDS).read_text(encoding="utf-8")) if folder else {}
        return {str(part): float(seconds) for part, seconds in stored.get(command, {}).items()}
    return {}


def store_seconds(command: str, seconds: Mapping[str, float]) -> None:
    """Store the seconds for the next time; do nothing where they cannot be written."""
    folder = user_cache("times")
    if folder is None:
        return
    stored: object = {}
    with suppress(OSError, ValueError):
        stored = json.loads((folder / SECONDS).read_text(encoding="utf-8"))
    stored = stored if isinstance(stored, dict) else {}
    stored[command] = {part: round(taken, 1) for part, taken in seconds.items()}
    with suppress(OSError, InputError), replacing(folder / SECONDS) as part:
        part.write_text(json.dumps(stored), encoding="utf-8")
