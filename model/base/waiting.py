"""Progress reports of long work, for the command line (app/command), on which the model does not depend."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Item = TypeVar("Item")
INTERVAL = 0.1  # s between two reports


class Watchers(list[Callable[..., None]]):
    """Functions that are called with the arguments of `notify`, each while its `watched` block lasts."""

    @contextmanager
    def watched(self, watcher: Callable[..., None]) -> Iterator[None]:
        """Call `watcher` for everything that happens within the block."""
        self.append(watcher)
        try:
            yield
        finally:
            self.remove(watcher)

    def notify(self, *what: object) -> None:
        """Call every watcher with the argument `what`."""
        for watcher in self:
            watcher(*what)


_of_work = Watchers()
# its watcher(label, fraction): the work, and its fraction done, None if that is unknown, 1 at its end
waiting_watched = _of_work.watched
report = _of_work.notify


@contextmanager
def work(label: str) -> Iterator[None]:
    """Report the block as work of unknown length. Usable as a decorator."""
    report(label, None)
    try:
        yield
    finally:
        report(label, 1.0)


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
