"""A bar for work of the model that takes longer than a moment: reading meshes, cutting bodies, sampling fields."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from app.output.bar import Bar
from model.core.waiting import waiting_watched

SHOWN_AFTER = 0.5  # s: work that goes on for longer gets a bar


class _Waiting:
    """What is under way, outermost first, and the bar of the innermost; from SHOWN_AFTER on, whether or not it reports."""

    def __init__(self) -> None:
        self.active: dict[str, float | None] = {}
        self.lock = threading.RLock()  # of the timer's thread and the one that works
        self.timer: threading.Timer | None = None
        self.bar: Bar | None = None

    def watch(self, label: str, fraction: float | None) -> None:
        """See model/core/waiting.py."""
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
        """Remove the bar, or let none appear."""
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
                    TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn()
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
    """Within it, a terminal shows a bar for work of the model that takes longer than a moment; nested, the outer one does."""
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
