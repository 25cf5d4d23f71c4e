"""Progress bars of a sweep on many machines: the whole, and a line per worker with its progress and activity."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from types import TracebackType
from typing import Any

from softlab.bench.cluster.folder import Status
from softlab.bench.measure.progress import progress_bar


def groups(count: int) -> str:
    """Return e.g. `1 group` or `2 groups`."""
    return f"{count} group{'s' * (count != 1)}"


class WorkerBars:
    """Context manager of the progress bars; shows nothing unless `show`."""

    def __init__(self, show: bool):
        self.bars = progress_bar(show)
        self.lines: dict[str, Any] = {}

    def __enter__(self) -> WorkerBars:
        self.bars.__enter__()
        self.all = self.bars.add_task("waiting for workers", total=None)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.bars.__exit__(kind, error, traceback)

    def show(
        self, plan: Mapping[str, float], done: Collection[str], statuses: Iterable[Status], here: Collection[str]
    ) -> None:
        """Update the bars.

        `plan`: all groups and their weights; `statuses`: of all workers so far; `here`: names of the current ones.
        """
        total = sum(plan.values()) or None
        behind = sum(plan.get(claim, 0.0) for claim in done)
        if plan:
            self.bars.update(self.all, description=f"{len(done)} of {len(plan)} groups", total=total, completed=behind)
        for status in statuses:
            description = f"worker {status.name} on host {status.host}: {groups(len(status.done))}; "
            description += status.ended or status.doing if status.name in here else "gone"
            completed = sum(plan.get(claim, 0.0) for claim in status.done)
            if status.name not in self.lines:
                self.lines[status.name] = self.bars.add_task(description, total=total)
            self.bars.update(self.lines[status.name], description=description, total=total, completed=completed)
