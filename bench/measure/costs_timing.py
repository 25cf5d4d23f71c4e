"""Ratios of times: variants of the same steps, sampled in turn in one process, each over the first one."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from softlab.bench.measure.samples import in_turns
from softlab.bench.measure.timing import Sample, Subject
from softlab.bench.store.database import Store
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.schema import Description

STAGE = "costs"  # of the samples in the store
RATIO, LEAST, MOST = "cost_ratio", "cost_ratio_least", "cost_ratio_most"  # of time a step, over the first variant's
SECONDS, QUICKEST = "cost_seconds", "cost_seconds_least"  # a step: the median, the least

Measures = dict[str, tuple[float | None, str, str | None]]  # name -> value, unit, reason


@dataclass(frozen=True)
class Effort:
    """`repeats` samples of `seconds` [s] each; `most`: limit of one sample [s], as far as its minimum number of steps
    allows."""

    repeats: int
    seconds: float
    most: float


QUICK, FULL = Effort(3, 0.02, 0.5), Effort(9, 0.2, 3.0)


@dataclass(frozen=True)
class Variant:
    """One variant of the steps: its description, and the hash of the code that it depends on."""

    description: Description
    sources: str


@dataclass(frozen=True)
class Record:
    """Destination of samples: a run of a store, under the hash of the sources. `report(text)`: progress in words."""

    store: Store
    run: str
    sources: str
    report: Callable[[str], None] = lambda text: None

    def variant(self, description: Description) -> Variant:
        return Variant(description, self.sources)


def in_turn(record: Record, subjects: Sequence[Subject], repeats: int) -> list[Measures]:
    """Sample the subjects A B C A B C ..., whose names are their descriptions, and return the costs relative to the first.

    A ratio compares two consecutive samples: median, minimum and maximum over the repeats.
    """
    sampled = in_turns(record.store, record.run, STAGE, subjects, repeats, record.variant)
    taken = {id(subject): samples for subject, samples in sampled}
    first = taken[id(subjects[0])]
    return [_over(first, taken[id(subject)]) for subject in subjects]


def _over(base: Sequence[Sample], samples: Sequence[Sample]) -> Measures:
    times = [sample.seconds / sample.steps for sample in samples]
    ratios = [seconds / (first.seconds / first.steps) for seconds, first in zip(times, base, strict=True)]
    beside = [
        sample.suspect for sample in base if not is_wrong(sample.suspect)
    ]  # the marks of a wrong first sample concern the ratios alone
    marks = dict.fromkeys(mark for mark in (*beside, *(sample.suspect for sample in samples)) if mark)
    reason = "; ".join([f"of {len(ratios)} pairs", *marks])
    return {
        SECONDS: (statistics.median(times), "s", reason),
        QUICKEST: (min(times), "s", reason),
        LEAST: (min(ratios), "", reason),
        MOST: (max(ratios), "", reason),
        RATIO: (statistics.median(ratios), "", reason),
    }
