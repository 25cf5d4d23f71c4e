"""What experiments are made of: what one measures and stores, those that are sampled in turn, and what was done."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.experiments.sweep import host_of, source_hash
from bench.measure import costs_timing
from bench.measure.costs_timing import RATIO, Measures, Record
from bench.measure.machine import enter_machine
from bench.measure.progress import progress_bar
from bench.store.database import Store
from bench.store.results import configuration
from bench.store.versions import code_version
from model.core.digest import source_digest
from model.scene.scene import Scene

COSTS_VERSION = 1  # part of the resume key of every cost: raise it when how they are sampled changes


@dataclass
class FindingsSummary:
    """What `run_findings`, or `run_costs`, did: measures made now, and found in the store; `seconds`; `interrupted` by
    Ctrl-C; `what` they are called."""

    machine: str
    what: str = "findings"
    run: str = ""
    measured: int = 0
    held: int = 0
    seconds: float = 0.0
    interrupted: bool = False

    def __str__(self) -> str:
        text = f"{self.what}: {self.measured} measured, {self.held} held in the store, {self.seconds:.0f} s"
        return text + ("; interrupted: the same command resumes" if self.interrupted else "")


@dataclass(frozen=True)
class Experiment:
    """One configuration of one finding. `name`: the measure by which the store knows that it is done."""

    name: str
    description: dict[str, Any]
    sources: str
    measure: Callable[[], Measures]

    def __str__(self) -> str:
        return str(self.description["finding"])

    def run(self, store: Store, run: str) -> None:
        """Measure it, and put its numbers into the store, all or none."""
        numbers = self.measure()
        with store.transaction():
            for name, (value, unit, reason) in numbers.items():
                store.add_measure(run, self.description, self.sources, name, value, unit, reason)


def described(scene: Scene, backend: str, finding: str, **how: Any) -> dict[str, Any]:
    """A configuration of an experiment: as everywhere, plus its finding and what it varies."""
    known = {name: how.pop(name) for name in ("precision", "math", "kernel") if name in how}
    return configuration(scene, backend=backend, **host_of(backend), **known) | {"finding": finding} | how


# ---------------------------------------------------------------------- what is sampled in turn


@dataclass(frozen=True)
class Group:
    """What is sampled in turn. `descriptions`: of each way; the last one's RATIO, stored last, tells that all is done.
    `measure`: samples into a record, the measures of each way out."""

    name: str
    descriptions: tuple[dict[str, Any], ...]
    sources: str
    measure: Callable[[Record], list[Measures]]


def cost_sources(backend: str, *files: str) -> str:
    """The hash of what a cost depends on: the backend's sources, what is timed beside them, and how."""
    paths = [Path(file) for file in (*files, str(costs_timing.__file__))]
    return f"{source_hash(backend)}-{source_digest(*paths)}-c{COSTS_VERSION}"


def measure_groups(store: Store, what: str, everything: Sequence[Group], show: bool, command: str) -> FindingsSummary:
    """Measure what the store lacks of the groups, one after another, and say what was done. `what` they are called;
    `show`: a progress bar. Ctrl-C ends cleanly."""
    begin = time.perf_counter()
    summary = FindingsSummary(enter_machine(store), what)
    try:
        missing = [
            g for g in everything if not store.has_measure(g.descriptions[-1], summary.machine, g.sources, RATIO)
        ]
        summary.held = len(everything) - len(missing)
        if missing:
            summary.run = store.start_run(summary.machine, command, code_version())
            _measure(store, summary, missing, show)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.seconds = time.perf_counter() - begin
    return summary


def _measure(store: Store, summary: FindingsSummary, missing: Sequence[Group], show: bool) -> None:
    with progress_bar(show) as bar:
        task = bar.add_task(summary.what, total=len(missing))
        for group in missing:
            bar.update(task, description=f"{summary.what}: {group.name}")
            found = group.measure(Record(store, summary.run, group.sources))
            with store.transaction():
                for description, numbers in zip(group.descriptions, found, strict=True):
                    for name, (value, unit, reason) in numbers.items():
                        store.add_measure(summary.run, description, group.sources, name, value, unit, reason)
            summary.measured += 1
            bar.advance(task)
