"""A progress bar for long work of the model: reading meshes, cutting bodies, sampling fields."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from softlab.app.output.bar import Bar
from softlab.model.base.waiting import waiting_watched

SHOWN_AFTER = 0.5  # s: longer work gets a bar


class _Waiting:
    """The active work, outermost first, and a bar that shows the innermost. A timer starts the bar, so that work
    without progress reports has one, too."""

    def __init__(self) -> None:
        self.active: dict[str, float | None] = {}
        self.lock = threading.RLock()  # shared by the timer's thread and the working one
        self.timer: threading.Timer | None = None
        self.bar: Bar | None = None

    def watch(self, label: str, fraction: float | None) -> None:
        """Receive a progress report of model/base/waiting.py."""
        with self.lock:
            if fraction is not None and fraction >= 1:
                self.active.pop(label, None)
            else:
                self.active[label] = fraction
            if not self.active:
                self.stop()
            elif self.bar is not None:
                self._update(self.bar)
            elif self.timer is None:
                self.timer = threading.Timer(SHOWN_AFTER, self._begin)
                self.timer.daemon = True
                self.timer.start()

    def stop(self) -> None:
        """Remove the bar, or cancel its timer."""
        with self.lock:
            if self.timer is not None:
                self.timer.cancel()
            if self.bar is not None:
                self.bar.stop()
            self.timer = self.bar = None

    def _begin(self) -> None:
        with self.lock:
            if self.active and self.timer is threading.current_thread():
                self.bar = Bar(
                    (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
                )
                self.bar.add_task("", total=None)
                self._update(self.bar)
                self.bar.start()

    def _update(self, bar: Bar) -> None:
        label, fraction = list(self.active.items())[-1]
        task = bar.tasks[0].id
        bar.update(task, description=label, total=None if fraction is None else 1.0, completed=fraction or 0.0)


_outermost: _Waiting | None = None


@contextmanager
def waiting_shown() -> Iterator[None]:
    """Show a bar on a terminal for long work of the model within the block; a nested block leaves that to the outer one."""
    global _outermost
    if _outermost is not None:
        yield
        return
    _outermost = _Waiting()
    try:
        with waiting_watched(_outermost.watch):
            yield
    finally:
        _outermost.stop()
        _outermost = None
