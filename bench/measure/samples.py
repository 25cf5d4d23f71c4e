"""Samples on their way into the store: taken in turn, marked, and written before the next one is taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol

from softlab.bench.measure.gpu import gpu_simulated
from softlab.bench.measure.timing import Neighbours, Sample, Subject, interleaved
from softlab.bench.store.database import Store
from softlab.bench.store.schema import Description

SIMULATED = "CUDA simulator, no GPU"  # a mark of a sample


class Case(Protocol):
    """One configuration: its description and the hash of the code it depends on, which identify it in the store."""

    @property
    def description(self) -> Description: ...
    @property
    def sources(self) -> str: ...


def stored_samples(
    store: Store,
    run: str,
    stage: str,
    samples: Iterable[tuple[Subject, Sample]],
    case_of: Callable[[Any], Case] = lambda name: name,
    warning: Callable[[Any], str | None] = lambda name: None,
) -> Iterator[tuple[Subject, Sample]]:
    """Yield the samples as they are taken, each stored with all its marks before the next one is taken.

    `case_of`, `warning`: functions of a subject's name: its case, and a further mark of its samples.
    """
    for subject, sample in samples:
        case = case_of(subject.name)
        simulated = SIMULATED if case.description["backend"] == "gpu" and gpu_simulated() else None
        suspect = "; ".join(filter(None, (sample.suspect, warning(subject.name), simulated))) or None
        store.add_sample(
            run, case.description, case.sources, sample.seconds, sample.steps, stage=stage, suspect=suspect
        )
        yield subject, replace(sample, suspect=suspect)


def in_turns(
    store: Store,
    run: str,
    stage: str,
    subjects: Sequence[Subject],
    repeats: int,
    case_of: Callable[[Any], Case] = lambda name: name,
) -> Iterator[tuple[Subject, list[Sample]]]:
    """Sample the subjects A B C A B C ..., `repeats` times each; yield each with its samples as soon as it has all."""
    taken: dict[int, list[Sample]] = {id(subject): [] for subject in subjects}
    samples = interleaved(subjects, [repeats] * len(subjects), Neighbours())
    for subject, sample in stored_samples(store, run, stage, samples, case_of):
        taken[id(subject)].append(sample)
        if len(taken[id(subject)]) == repeats:
            yield subject, taken[id(subject)]
