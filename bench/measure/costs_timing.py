"""Times behind a ratio: ways to do the same steps, sampled in turn in one process, each over the first one."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from bench.measure.machine import gpu_simulated
from bench.measure.timing import Neighbours, Subject, interleaved
from bench.store.database import Store

STAGE = "costs"  # of the samples in the store
RATIO, LEAST, MOST = "cost_ratio", "cost_ratio_least", "cost_ratio_most"  # of time a step, over the first way's
SECONDS, QUICKEST = "cost_seconds", "cost_seconds_least"  # a step: the median, the least

Measures = dict[str, tuple[float | None, str, str | None]]  # name -> value, unit, reason


@dataclass(frozen=True)
class Effort:
    """`repeats` samples of `seconds` [s] each; `most`: of one sample [s], as far as its least number of steps allows."""

    repeats: int
    seconds: float
    most: float


QUICK, FULL = Effort(3, 0.02, 0.5), Effort(9, 0.2, 3.0)


@dataclass(frozen=True)
class Record:
    """Where samples go: a run of a store, under the hash of the sources."""

    store: Store
    run: str
    sources: str


def in_turn(record: Record, subjects: Sequence[Subject], repeats: int) -> list[Measures]:
    """Sample the subjects A B C A B C ..., whose names are their descriptions, and say what each takes over the first.

    A ratio is of two samples that were taken one after the other: the median over the repeats, the least and the most.
    """
    taken: list[list[float]] = [[] for _ in subjects]
    marks: list[list[str]] = [[] for _ in subjects]
    place = {id(subject): k for k, subject in enumerate(subjects)}
    for subject, sample in interleaved(subjects, [repeats] * len(subjects), Neighbours()):
        description: dict[str, Any] = subject.name
        simulated = "CUDA simulator, no GPU" if description["backend"] == "gpu" and gpu_simulated() else None
        suspect = "; ".join(filter(None, (sample.suspect, simulated))) or None
        record.store.add_sample(
            record.run, description, record.sources, sample.seconds, sample.steps, stage=STAGE, suspect=suspect
        )
        taken[place[id(subject)]].append(sample.seconds / sample.steps)
        marks[place[id(subject)]] += [suspect] if suspect else []
    return [
        _over(taken[0], times, list(dict.fromkeys(marks[0] + mine))) for times, mine in zip(taken, marks, strict=True)
    ]


def _over(base: Sequence[float], times: Sequence[float], marks: Sequence[str]) -> Measures:
    ratios = [mine / first for mine, first in zip(times, base, strict=True)]
    reason = "; ".join([f"of {len(ratios)} pairs", *marks])
    return {
        SECONDS: (statistics.median(times), "s", reason),
        QUICKEST: (min(times), "s", reason),
        LEAST: (min(ratios), "", reason),
        MOST: (max(ratios), "", reason),
        RATIO: (statistics.median(ratios), "", reason),
    }
