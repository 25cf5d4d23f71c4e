"""Timing cases, a scene on a backend each, into the store: checked states, groups in turn, resumable; see
bench/measure/timing.py."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

from softlab.app.driver import open_simulation
from softlab.bench.measure import experiment
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.experiment import Report, backends_here, host_of, resume, source_hash
from softlab.bench.measure.samples import in_turns
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import Measure, by_configuration, configuration
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.simulation import PRECISIONS, Simulation
from softlab.model.scene.scene import Scene

SAMPLE_SECONDS, MAX_SAMPLE = 0.05, 3.0
REPEATS, QUICK_REPEATS = 7, 3
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
    """Return a case with the description that the store uses."""
    description = configuration(scene, backend=backend, precision=precision, **host_of(backend))
    return Case(scene, backend, description, source_hash(backend), label)


def ready(stack: ExitStack, case: Case, seconds: float, most: float) -> Subject:
    """Open a case until the stack closes, and `prepare` samples of `seconds` [s], at most `most` [s]. Raises Diverged."""
    return prepare(Subject(stack.enter_context(case.open()), case), seconds, most)


@dataclass
class Summary(experiment.Summary):
    """Summary with `skipped`: configurations that could not run."""

    skipped: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.counts('timed')}", *(f"left out: {reason}" for reason in self.skipped)]
        return "\n  ".join(lines) + self.ending("\n  ")


@dataclass(frozen=True)
class RatePoint:
    """One timed configuration: `step` [s], `rate` [1/s]; `incomplete`: its state lacks some of its physics."""

    machine: str
    backend: str
    precision: str
    kernel: str
    step: float
    rate: float
    incomplete: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class Rates:
    """Experiment on the rate of work of cases. `name`: also of its command; `stage`: of its samples;
    `step`, `rate`, `kernel`: names of its measures, the median step [s], `work` of the scene in a step over it [1/s], and
    the kernel that ran; `words`: further measures, with a word on the scene; `groups(backends, quick, precisions, ...)`:
    the groups that are timed in turn."""

    name: str
    stage: str
    step: str
    rate: str
    kernel: str
    work: Callable[[Scene], float]
    groups: Callable[..., Sequence[Sequence[Case]]]
    words: Mapping[str, Callable[[Scene], str]] = field(default_factory=dict)

    def __call__(
        self,
        store: Store,
        *,
        quick: bool = False,
        backends: Sequence[str] | None = None,
        precisions: Sequence[str] = ("float32",),
        progress: bool = True,
        command: str = "",
        **chosen: Any,
    ) -> Summary:
        """Time the cases that the store lacks, those of a group in turn, and return a summary. `quick`: fewer cases and
        repeats; `chosen`: further arguments of `groups`. Ctrl-C ends cleanly.

        Raises SceneError (an impossible choice), BackendUnavailable, InputError (the store).
        """
        here, repeats = backends_here(backends), QUICK_REPEATS if quick else REPEATS
        for precision in precisions:
            if precision not in PRECISIONS:
                raise SceneError("--precision", precision, f"must be one of {', '.join(PRECISIONS)}")
        groups = self.groups(here, quick, precisions, **chosen)
        summary = Summary.begun(store, self.name)

        def measure(group: Sequence[Case], report: Report) -> None:
            report(str(group[0]), 0)
            self._time(store, summary, group, repeats)
            report(str(group[0]), len(group))

        def is_stored(case: Case) -> bool:
            key = case.description, summary.machine, case.sources
            return store.has_measure(*key, self.rate) and store.sample_count(*key, self.stage) >= repeats

        command = command or f"softlab {self.name}"
        return resume(store, summary, groups, is_stored, measure, progress=progress, command=command)

    def _time(self, store: Store, summary: Summary, group: Sequence[Case], repeats: int) -> None:
        """Time one group in turn, and store its samples and measures."""
        with ExitStack() as stack:
            subjects = []
            for case in group:
                try:
                    subjects.append(ready(stack, case, SAMPLE_SECONDS, MAX_SAMPLE))
                except Diverged as error:
                    summary.skipped.append(f"{case}: {error}")
            for subject, samples in in_turns(store, summary.run, self.stage, subjects, repeats):
                case, step = subject.name, statistics.median(s.seconds / s.steps for s in samples)
                marks = [sample.suspect for sample in samples if is_wrong(sample.suspect)]
                numbers = self.besides(subject) | self.numbers(case.scene, step, subject.simulation.kernel, *marks[:1])
                experiment.store_measures(store, summary.run, case.description, case.sources, numbers)
                summary.measured += 1

    def besides(self, subject: Subject) -> Measures:
        """Further measures of a case that has just been timed."""
        return {}

    def numbers(self, scene: Scene, step: float, kernel: str, mark: str | None = None) -> Measures:
        """The measures of a case whose step took so many seconds, with the `mark` of a wrong or incomplete state; the rate
        last: then all is there."""
        words = {self.kernel: kernel} | {name: word(scene) for name, word in self.words.items()}
        return {
            self.step: (step, "s", "; ".join(filter(None, ("the median", mark)))),
            **{name: (None, "", word) for name, word in words.items()},
            self.rate: (self.work(scene) / step, "1/s", None),
        }

    def results(
        self, measures: Iterable[Measure], every: bool = False
    ) -> Iterator[tuple[dict[str, Measure], Scene, RatePoint]]:
        """Yield (measures, scene, point) of every timed case. Cases with wrong or incomplete states only with `every`, since
        their times prove nothing."""
        needed = {self.step, self.rate, *self.words}
        for by_name in by_configuration(measure for measure in measures if measure.name in {*needed, self.kernel}):
            if needed <= set(by_name):
                step, rate = by_name[self.step], by_name[self.rate]
                kernel = (by_name[self.kernel].reason if self.kernel in by_name else None) or ""
                precision = rate.description["precision"]
                values = step.value or 0.0, rate.value or 0.0
                wrong = is_wrong(step.reason)
                if wrong and not every:
                    continue
                point = RatePoint(rate.machine, rate.backend, precision, kernel, *values, incomplete=wrong)
                yield by_name, Scene.stored(rate.description["scene"]), point


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

    def is_stored(self, store: Store, machine: str) -> bool:
        """Return True if the store has all samples of the group."""
        return all(store.sample_count(c.description, machine, c.sources, FINDINGS) >= self.repeats for c in self.group)

    def run(self, store: Store, run: str, report: Callable[[str], None]) -> None:
        """Sample the group into the store."""
        with ExitStack() as stack:
            subjects = [ready(stack, case, *((0.02, 0.5) if self.quick else (0.1, 3.0))) for case in self.group]
            list(in_turns(store, run, FINDINGS, subjects, self.repeats))
