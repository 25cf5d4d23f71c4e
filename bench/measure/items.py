"""Experiments of single items, measured one after another, in the frame of bench/measure/experiment.py."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar, Protocol

from softlab.bench.measure import costs_timing
from softlab.bench.measure.costs_timing import RATIO, Measures, Record
from softlab.bench.measure.declaration import Choices, Experiment, RowType
from softlab.bench.measure.experiment import Report, Summary, source_hash, store_measures
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description
from softlab.model.base.digest import source_digest

COSTS_VERSION = 1  # part of the resume key of every cost: raise it when how they are sampled changes


class Item(Protocol):
    """A unit of measurement; `worth`: its length on the progress bar. `report(text)`: the current step in words."""

    @property
    def worth(self) -> int: ...
    def is_stored(self, store: Store, machine: str) -> bool: ...
    def run(self, store: Store, run: str, report: Callable[[str], None]) -> None: ...


class Items(Experiment[Item, RowType]):
    """Base of experiments with single items, measured one after another; `doing`: text of the progress bar."""

    doing: ClassVar[str] = ""
    items: ClassVar[Callable[..., Sequence[Item]]]  # (store, backends, quick, options) -> all, or (`quick`) fewer

    def plan(self, store: Store, backends: Sequence[str], quick: bool, options: Choices) -> list[list[Item]]:
        return [[item] for item in self.items(store, backends, quick, **options)]

    def is_stored(self, store: Store, machine: str, quick: bool, case: Item) -> bool:
        return case.is_stored(store, machine)

    def measure(self, store: Store, summary: Summary, quick: bool, group: Sequence[Item], report: Report) -> None:
        for item in group:
            report(f"{self.doing}{item}", 0)
            item.run(store, summary.run, partial(_within, report, f"{self.doing}{item}"))
            summary.measured += 1
            report(f"{self.doing}{item}", item.worth)


def _within(report: Report, name: str, text: str) -> None:
    report(f"{name}: {text}", 0)


@dataclass(frozen=True)
class Finding:
    """One configuration of one finding. `name`: the measure whose presence in the store means that it is done."""

    name: str
    description: Description
    sources: str
    measure: Callable[[], Measures]
    worth: int = 1

    def __str__(self) -> str:
        return str(self.description["finding"])

    def is_stored(self, store: Store, machine: str) -> bool:
        return store.has_measure(self.description, machine, self.sources, self.name)

    def run(self, store: Store, run: str, report: Callable[[str], None]) -> None:
        """Measure the configuration, and store all of its numbers or none."""
        store_measures(store, run, self.description, self.sources, self.measure())


@dataclass(frozen=True)
class Group:
    """Variants that are sampled in turn. `descriptions`: of each; the last one's RATIO is stored last and marks all as done.
    `measure`: samples into a record and returns the measures of each variant."""

    name: str
    descriptions: tuple[Description, ...]
    sources: str
    measure: Callable[[Record], list[Measures]]
    worth: int = 1

    def __str__(self) -> str:
        return self.name

    def is_stored(self, store: Store, machine: str) -> bool:
        return store.has_measure(self.descriptions[-1], machine, self.sources, RATIO)

    def run(self, store: Store, run: str, report: Callable[[str], None]) -> None:
        measures = self.measure(Record(store, run, self.sources, report))
        with store.transaction():
            for description, numbers in zip(self.descriptions, measures, strict=True):
                store_measures(store, run, description, self.sources, numbers)


def cost_sources(backend: str, files: Iterable[str | Path]) -> str:
    """Return the hash that a cost depends on: of the backend's sources, of other timed code, and of the timing itself."""
    paths = [Path(file) for file in (*files, str(costs_timing.__file__))]
    return f"{source_hash(backend)}-{source_digest(*paths)}-c{COSTS_VERSION}"
