"""Summary of a sweep on many machines: counted in the store, and reported by the workers."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

from rich.console import Console

from softlab.bench.cluster.bar import groups
from softlab.bench.cluster.folder import Status
from softlab.bench.measure.cases import SweepSummary
from softlab.bench.store.database import Store


@dataclass
class ClusterSummary(SweepSummary):
    """Results of all workers.

    `workers`: a line per worker that finished something; `machines`: keys of the store; `losses`: lost workers with
    their groups, which others took, and reasons; `abandoned`: groups that were not measured or slots that are not
    restarted, with reasons; `unmerged`: files that could not be merged, with reasons.
    """

    workers: list[str] = field(default_factory=list)
    machines: list[str] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    abandoned: list[str] = field(default_factory=list)
    unmerged: list[str] = field(default_factory=list)


def count(summary: ClusterSummary, store: Store, before: int, statuses: Collection[Status]) -> None:
    """Fill in the results, from the store's runs after number `before` and from the workers' statuses."""
    runs = "SELECT key FROM run WHERE rowid > ?"
    ((summary.samples, suspect),) = store.query(
        f"SELECT count(*), sum(suspect IS NOT NULL) FROM sample WHERE stage <> 'compile' AND run IN ({runs})", (before,)
    )
    summary.suspect = suspect or 0
    table, wanted = ("sample", "stage <> 'compile'") if summary.samples else ("measure", "name <> 'skipped'")
    ((summary.measured,),) = store.query(
        f"SELECT count(*) FROM (SELECT DISTINCT configuration, machine FROM {table} JOIN run ON run.key = run "
        f"WHERE {wanted} AND run.rowid > ?)",
        (before,),
    )
    # results that the store had at the beginning; all workers on equal machines report the same
    stored: dict[str, int] = {}
    for status in statuses:
        stored[status.machine] = max(stored.get(status.machine, 0), int(status.counts.get("stored", 0)))
        summary.compile_seconds += status.counts.get("compile_seconds", 0.0)
        if status.done:
            done = groups(len(status.done))
            summary.workers.append(f"worker {status.name} on host {status.host}, {status.label}: {done}")
    summary.stored = sum(stored.values())
    for name in ("skipped", "wrong"):
        entries = [(str(what), str(why)) for status in statuses for what, why in getattr(status, name)]
        setattr(summary, name, list(dict.fromkeys(entries)))
    summary.machines = list(dict.fromkeys(status.machine for status in statuses if status.machine))
    summary.machine = next(iter(summary.machines), "")
    summary.stop()


def print_workers(console: Console, summary: ClusterSummary) -> None:
    """Print the results of each worker, lost workers, and groups that were not measured."""
    lines = [*summary.workers, *(f"lost: {text}" for text in summary.losses)]
    lines += [f"given up: {text}" for text in summary.abandoned] + [f"not merged: {text}" for text in summary.unmerged]
    if len(summary.machines) > 1:
        lines.append(
            f"{len(summary.machines)} kinds of machine, each with a sweep of its own: their times are never one curve"
        )
    for line in lines:
        console.print(f"  {line}", markup=False, soft_wrap=True)
