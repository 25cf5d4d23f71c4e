"""Timing cases, a scene on a backend each, into the store: checked states, groups in turn, resumable; see
bench/measure/timing.py."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from app.driver import open_simulation
from bench.measure import experiment
from bench.measure.experiment import Tell, host_of, resume, source_hash, stored_samples
from bench.measure.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from bench.store.database import Store
from bench.store.results import configuration
from model.core.errors import Diverged, SceneError
from model.core.simulation import PRECISIONS, Simulation
from model.scene.scene import Scene

SAMPLE_SECONDS, MAX_SAMPLE = 0.05, 3.0
FINDINGS = "findings"  # stage of the samples behind findings


@dataclass(frozen=True)
class Case:
    """One configuration, and the description and source hash by which the store knows it. `label`: what a user reads."""

    scene: Scene
    backend: str
    description: dict[str, Any]
    sources: str
    label: str

    def __str__(self) -> str:
        return f"{self.label}, {self.backend}"

    @property
    def precision(self) -> str:
        return self.description["precision"]

    @property
    def math(self) -> str:
        return self.description["math"]

    def open(self) -> Simulation:
        return open_simulation(self.scene, self.backend, precision=self.precision, math=self.math)


def make_case(scene: Scene, backend: str, precision: str, label: str) -> Case:
    """One configuration, described as the store holds it."""
    description = configuration(scene, backend=backend, precision=precision, **host_of(backend))
    return Case(scene, backend, description, source_hash(backend), label)


def ready(stack: ExitStack, case: Case, seconds: float, most: float) -> Subject:
    """The case, opened as long as the stack is, warmed up, its steps chosen for samples of `seconds` [s], at `most` [s].
    Raises Diverged."""
    subject = Subject(stack.enter_context(case.open()), case)
    warm_up(subject)
    choose_steps(subject, seconds, most)
    return subject


@dataclass
class Summary(experiment.Summary):
    """What was done; `skipped`: configurations that could not run."""

    skipped: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        told = [f"{self.name}: {self.counts('timed')}", *(f"left out: {reason}" for reason in self.skipped)]
        return "\n  ".join(told) + self.ending("\n  ")


Measured = Iterable[tuple[str, float | None, str, str | None]]  # name, value, unit, reason


@dataclass(frozen=True)
class Timing:
    """A kind of timing: its `name`, also that of its samples' stage in the store; how often a case is timed; what is told of
    a case, whose step took so many seconds by a kernel (`measured`), and the one of those measures that every case has
    (`told`)."""

    name: str
    repeats: int
    measured: Callable[[Case, float, str], Measured]
    told: str

    def run(self, store: Store, groups: Sequence[Sequence[Case]], *, progress: bool, command: str) -> Summary:
        """Time what the store lacks of the cases, those of a group in turn. Ctrl-C ends cleanly. Raises BackendUnavailable,
        InputError (the store)."""
        summary = Summary.begun(store, self.name)

        def measure(group: Sequence[Case], tell: Tell) -> None:
            tell(str(group[0]), 0)
            self._time(store, summary, group)
            tell(str(group[0]), len(group))

        def held(case: Case) -> bool:
            return self._held(store, case, summary.machine)

        return resume(store, summary, groups, held, measure, progress=progress, command=command)

    def _held(self, store: Store, case: Case, machine: str) -> bool:
        key = case.description, machine, case.sources
        return store.has_measure(*key, self.told) and store.sample_count(*key, self.name) >= self.repeats

    def _time(self, store: Store, summary: Summary, group: Sequence[Case]) -> None:
        """Time one group in turn, and store its samples and measures."""
        with ExitStack() as stack:
            subjects = []
            for case in group:
                try:
                    subjects.append(ready(stack, case, SAMPLE_SECONDS, MAX_SAMPLE))
                except Diverged as error:
                    summary.skipped.append(f"{case}: {error}")
            taken: dict[int, list[float]] = {}
            samples = interleaved(subjects, [self.repeats] * len(subjects), Neighbours())
            for subject, sample in stored_samples(store, summary.run, self.name, samples):
                case = subject.name
                times = taken.setdefault(id(subject), [])
                times.append(sample.seconds / sample.steps)
                if len(times) == self.repeats:
                    found = self.measured(case, statistics.median(times), subject.simulation.kernel)
                    for name, value, unit, reason in found:
                        store.add_measure(summary.run, case.description, case.sources, name, value, unit, reason)
                    summary.measured += 1


@dataclass(frozen=True)
class StepTimes:
    """Configurations of one scene behind a finding, sampled in turn (A B A B ...) from its start. `name`: what they are
    called; `quick`: fewer and shorter samples."""

    name: str
    group: Sequence[Case]
    quick: bool
    worth: int = 10

    def __str__(self) -> str:
        return self.name

    @property
    def repeats(self) -> int:
        return 3 if self.quick else 5

    def held(self, store: Store, machine: str) -> bool:
        """Whether the store has all samples of the group."""
        return all(store.sample_count(c.description, machine, c.sources, FINDINGS) >= self.repeats for c in self.group)

    def run(self, store: Store, run: str) -> None:
        """Sample the group into the store."""
        with ExitStack() as stack:
            subjects = [ready(stack, case, *((0.02, 0.5) if self.quick else (0.1, 3.0))) for case in self.group]
            samples = interleaved(subjects, [self.repeats] * len(subjects), Neighbours())
            for _ in stored_samples(store, run, FINDINGS, samples):
                pass


def check_precisions(precisions: Iterable[str]) -> None:
    """Raise SceneError for one that there is not."""
    for precision in precisions:
        if precision not in PRECISIONS:
            raise SceneError("--precision", precision, f"must be one of {', '.join(PRECISIONS)}")
