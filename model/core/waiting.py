"""Steps of work that takes long, reported to whoever shows progress (app/command), without the model knowing who that is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
Watcher = Callable[[str, float], None]  # what is done, which fraction of it: 1 at its end
INTERVAL = 0.1  # s between two reports
_watchers: list[Watcher] = []


@contextmanager
def waiting_watched(watcher: Watcher) -> Iterator[None]:
    """Within it, `watcher(label, fraction)` is called as work goes on."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def report(label: str, fraction: float) -> None:
    """Report that `fraction` (0 to 1) of the work called `label` is done."""
    for watcher in _watchers:
        watcher(label, fraction)


def steps(items: Iterable[Item], count: int, label: str) -> Iterator[Item]:
    """Iterate over `count` items and report how many are done, every INTERVAL."""
    last = time.monotonic()
    shown = False
    try:
        for number, item in enumerate(items):
            yield item
            now = time.monotonic()
            if now - last > INTERVAL:
                report(label, (number + 1) / count)
                last, shown = now, True
    finally:
        if shown:
            report(label, 1.0)
