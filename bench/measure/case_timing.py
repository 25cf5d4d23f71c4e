"""Timing of cases, each a scene on a backend, into the store: checked states, groups in turn, resumable; see
bench/measure/timing.py."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar

from softlab.app.driver import open_simulation
from softlab.bench.measure import experiment
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.declaration import PRECISION, Choices, Experiment
from softlab.bench.measure.experiment import Report, host_of, source_hash
from softlab.bench.measure.samples import in_turns
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import Measure, by_configuration, configuration
from softlab.bench.store.schema import Description
from softlab.model.base.errors import Diverged
from softlab.model.core.simulation import Simulation
from softlab.model.core.spare import counts
from softlab.model.scene.scene import Scene

SAMPLE_SECONDS, MAX_SAMPLE = 0.05, 3.0
REPEATS, QUICK_REPEATS = 7, 3
FINDINGS = "findings"  # stage of the samples behind findings


@dataclass(frozen=True)
class Case:
    """One configuration, and the description and source hash by which the store knows it. `label`: its text for
    users."""

    scene: Scene
    backend: str
    description: Description
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
class Row:
    """One timed configuration: `step` [s], `rate` [1/s]; `incomplete`: its state lacks some of its physics; `measures` by
    name. Further attributes are the `fields` of its experiment.
    """

    machine: str
    backend: str
    precision: str
    kernel: str
    step: float
    rate: float
    incomplete: bool
    scene: Scene
    measures: Mapping[str, Measure] = field(repr=False)
    fields: Mapping[str, Callable[[Row], Any]] = field(repr=False)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name not in self.fields:
            raise AttributeError(name)
        return self.fields[name](self)


def _rank(row: Row, name: str) -> Any:
    value = getattr(row, name.lstrip("-"))
    return -value if name.startswith("-") else value


class Rates(Experiment[Case, Row]):
    """Experiment on the rate of work of cases.

    `step`, `rate`, `kernel`: names of its measures in the store, by default after `name`: the median step [s], `work` of the
    scene in a step over it [1/s], and the kernel that ran; `stage`: of its samples; `words`: further measures, with a word
    on the scene. `fields`: attribute of a row -> its value; `order`: attributes by which rows are sorted,
    with a minus from the largest on.
    """

    stage: ClassVar[str]
    step: ClassVar[str]
    rate: ClassVar[str]
    kernel: ClassVar[str]
    options = {"precisions": PRECISION}
    summary = Summary
    words: ClassVar[Mapping[str, Callable[[Scene], str]]] = {}
    fields: ClassVar[Mapping[str, Callable[[Row], Any]]] = {}
    order: ClassVar[Sequence[str]] = ("backend",)

    def __init_subclass__(cls) -> None:
        for measure, suffix in (("stage", "times"), ("step", "step"), ("rate", "rate"), ("kernel", "kernel")):
            if not hasattr(cls, measure):
                setattr(cls, measure, f"{cls.name}_{suffix}")

    def work(self, scene: Scene) -> float:
        """Return the work of a step."""
        return counts(scene).particles

    def scene(self, **axes: Any) -> Scene:
        """Return the scene of one combination of the options' values."""
        raise NotImplementedError

    def groups(self, *common: Any, **axes: Any) -> Sequence[Sequence[Case]]:
        """Return the groups that are timed in turn: on each backend all combinations of the options' values. `common`:
        (backends, quick); `axes`: `precisions`, and the values of the other options."""
        (backends, _), precisions = common, axes.pop("precisions")
        combinations = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
        labelled = [(self.scene(**one), ", ".join(f"{k} {v}" for k, v in one.items())) for one in combinations]
        return [
            [make_case(scene, backend, precision, label) for precision in precisions for scene, label in labelled]
            for backend in backends
        ]

    def plan(self, store: Store, backends: Sequence[str], quick: bool, options: Choices) -> Sequence[Sequence[Case]]:
        return self.groups(backends, quick, **options)

    def is_stored(self, store: Store, machine: str, quick: bool, case: Case) -> bool:
        key, repeats = (case.description, machine, case.sources), QUICK_REPEATS if quick else REPEATS
        return store.has_measure(*key, self.rate) and store.sample_count(*key, self.stage) >= repeats

    def measure(self, store: Store, summary: Summary, quick: bool, group: Sequence[Case], report: Report) -> None:
        report(str(group[0]), 0)
        self._time(store, summary, group, QUICK_REPEATS if quick else REPEATS)
        report(str(group[0]), len(group))

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
        """Return the measures of a case whose step took `seconds`, with the `mark` of a wrong or incomplete state; the
        rate comes last and marks the case as complete."""
        words = {self.kernel: kernel} | {name: word(scene) for name, word in self.words.items()}
        return {
            self.step: (step, "s", "; ".join(filter(None, ("the median", mark)))),
            **{name: (None, "", word) for name, word in words.items()},
            self.rate: (self.work(scene) / step, "1/s", None),
        }

    def rows(self, stored: Iterable[Measure], every: bool = False) -> list[Row]:
        """Return the timed cases in `order`. Those with wrong or incomplete states only with `every`, since their times prove
        nothing."""
        everything, needed, rows = list(stored), {self.step, self.rate, *self.words}, []
        timed = {(m.machine, m.configuration) for m in everything if m.name == self.rate}
        for by_name in by_configuration(m for m in everything if (m.machine, m.configuration) in timed):
            if needed <= set(by_name):
                step, rate = by_name[self.step], by_name[self.rate]
                kernel = (by_name[self.kernel].reason if self.kernel in by_name else None) or ""
                wrong, scene = is_wrong(step.reason), Scene.stored(rate.description["scene"])
                values = step.value or 0.0, rate.value or 0.0, wrong, scene, by_name, self.fields
                if every or not wrong:
                    rows.append(Row(rate.machine, rate.backend, rate.description["precision"], kernel, *values))
        return sorted(rows, key=lambda row: [_rank(row, name) for name in self.order])


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
