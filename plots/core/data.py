"""Data of the figures and the lab book: a user's own measurements and the committed ones, machine by machine.

A `Source` (made by plots/core/read.py) has the results of one machine in the sweep and the accuracy runs. The
`featured` sources of a figure are the user's own, or the committed ones if there are no others. Committed sources next
to own ones are `background`: drawn lightly, and labelled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from softlab.bench.peers.results import Ratio
from softlab.bench.store import marks
from softlab.bench.store.database import Store
from softlab.bench.store.results import Machine, Measure, Timing
from softlab.bench.store.versions import Version
from softlab.model.base.table import Table

Origin = Store | str | Path
Selection = TypeVar("Selection")
THREAD_WORDS = ("1x", "2x", "4x")
NO_GPU = "no GPU"  # in a machine's label
FULL = (
    # of the largest set of an experiment's configurations: a set of this size counts as complete, whatever the version
    0.9
)


class NotMeasured(Exception):
    """A figure or a sentence lacks what it needs; the text says what, unless it is empty."""


def needed(value: Selection | None, reason: str = "") -> Selection:
    """Return the value. Raises NotMeasured with the reason if it is None, False or empty; a number may be 0.0."""
    if not value and not isinstance(value, float):
        raise NotMeasured(reason)
    return value


@dataclass(frozen=True)
class Run:
    """One run of a measuring command; `version`: of the code; `started`: UTC, ISO 8601."""

    version: Version
    started: str
    command: str


@dataclass(frozen=True, eq=False)
class Source:
    """Measurements of one machine.

    `by_user`: by the user, else committed with the lab. `timings`: of the sweep, with the kernels that the lab chose, one
    threading layer and one wait policy (`threading`, the most frequent ones). `scene`: the sweep's, as nested tables
    without the grid's size. `costs`: of the accuracy runs, by configuration. `kernels`: timings of forced kernels;
    `energies`: samples with joules, by configuration; `defaults`: whether the backend would have chosen the forced
    kernel, by configuration. `peers`: timings with peers. `findings`: timings of single findings
    (bench/experiments/findings/experiment.py), small grids first. The timings of a stage are of one version of the code
    (bench/store/versions.py); `left_out`: number of those of other versions.
    `older`: description of the numbers whose kernels are not proved to be those of this code; `older_peers`: backends
    whose peers were timed beside older code. `alone`: committed, without any machine of
    the user's from which it must be distinguished.
    """

    machine: Machine
    by_user: bool
    timings: tuple[Timing, ...]
    measures: tuple[Measure, ...]
    runs: tuple[Run, ...]
    scene: Table = field(default_factory=dict)
    threading: tuple[str | None, str | None] = (None, None)
    costs: dict[str, Timing] = field(default_factory=dict)
    kernels: tuple[Timing, ...] = ()
    energies: dict[str, Timing] = field(default_factory=dict)
    defaults: dict[str, bool] = field(default_factory=dict)
    peers: tuple[Ratio, ...] = ()
    findings: tuple[Timing, ...] = ()
    left_out: int = 0
    alone: bool = False
    older: str = ""
    older_peers: frozenset[str] = frozenset()

    @property
    def processor(self) -> str:
        """Name of the processor, e.g. `AMD EPYC, 2 cores`."""
        return self.machine.label.split(";")[0].strip()

    @property
    def gpu(self) -> str | None:
        """Name of the GPU; None for a machine without one."""
        return self.machine.record.get("gpu")

    def device(self, backend: str) -> str | None:
        """Return the name of the hardware of a backend."""
        return self.gpu if backend == "gpu" else self.processor

    @property
    def label(self) -> str:
        """`committed` if these are committed measurements beside the user's own; else empty."""
        return "" if self.by_user or self.alone else "committed"

    @property
    def bracket(self) -> str:
        """Label as a suffix of a name, ` (committed)`."""
        return f" ({self.label})" if self.label else ""

    @property
    def versions(self) -> list[Version]:
        """Versions of the runs, in order of time."""
        return [run.version for run in self.runs]

    @property
    def code(self) -> str:
        """Versions of the runs, each once, in order of time: `commits 9613136a2b1c, 555bb0d37fcd`."""
        commits = list(dict.fromkeys(version.commit for version in self.versions if version.commit))
        others = dict.fromkeys(
            str(version) if version.cpu else "others of a commit that was not recorded"
            for version in self.versions
            if not version.commit
        )
        texts = [f"commit{'s' * (len(commits) > 1)} {', '.join(commits)}"] if commits else []
        return ", ".join([*texts, *others]) or str(Version(None))

    @property
    def date(self) -> str:
        """Day of the measurements, `2026-11-21`, or the first and the last."""
        days = [run.started[:10] for run in self.runs]
        return " to ".join(dict.fromkeys((min(days), max(days)))) if days else "unknown"

    @property
    def provenance(self) -> str:
        """Machine, commit and date in one line, for captions."""
        committed = "" if self.by_user else "Committed measurements: "
        return f"{committed}{self.machine.label}; {self.code}, measured {self.date}{self.older and '; '}{self.older}"

    @property
    def place(self) -> str:
        """Machine only, for text that states commit and date once."""
        parts = [part for part in self.machine.label.split("; ") if part != NO_GPU]
        return f"{' with '.join(parts)}{self.bracket}"

    def select(
        self,
        backend: str,
        word: str | None = None,
        precision: str = "float32",
        *,
        graphics: bool = False,
        square: bool = True,
    ) -> list[Timing]:
        """Return the sweep's timings of one curve, smallest grid first; `word`: 1x, 2x, 4x or a number; None on the
        GPU.
        """
        return [
            timing
            for timing in self.timings
            if timing.backend == backend
            and timing.thread_word == word
            and timing.precision == precision
            and timing.graphics == graphics
            and (not square or timing.rows == timing.columns)
        ]

    def ladder(self, backend: str, precision: str = "float32", word: str | None = "1x") -> dict[str, list[Timing]]:
        """Return the timings of every forced kernel at square sizes, smallest first, by kernel; `word`: threads on the
        CPU.
        """
        by_kernel: dict[str, list[Timing]] = {}
        for timing in self.kernels:
            wanted = timing.thread_word == (None if backend == "gpu" else word)
            if ":" in timing.kernel:  # a tile that was tried by hand is not a variant
                continue
            if wanted and (timing.backend, timing.precision) == (backend, precision) and timing.rows == timing.columns:
                by_kernel.setdefault(timing.kernel, []).append(timing)
        return by_kernel

    @property
    def has_gpu_times(self) -> bool:
        return any(timing.backend == "gpu" for timing in self.timings)


@dataclass(frozen=True, eq=False)
class Results:
    """All sources, the user's own first. Derived results are cached per instance (functools.lru_cache)."""

    sources: tuple[Source, ...]

    @property
    def featured(self) -> tuple[Source, ...]:
        users = tuple(source for source in self.sources if source.by_user)
        return users or self.sources

    @property
    def background(self) -> tuple[Source, ...]:
        return tuple(source for source in self.sources if source not in self.featured)

    @property
    def everyone(self) -> tuple[Source, ...]:
        """All sources in the order of preference, featured ones first."""
        return (*self.featured, *self.background)

    @property
    def committed(self) -> Results | None:
        """Committed sources only, if they are next to a user's own, for results that those lack."""
        sources = tuple(source for source in self.sources if not source.by_user)
        return Results(sources) if sources and len(sources) < len(self.sources) else None

    def first(self, holds: Callable[[Source], object]) -> Source | None:
        """Return the first source for which `holds` is true."""
        return next((source for source in self.everyone if holds(source)), None)

    def first_with(self, select: Callable[[Source], Selection]) -> tuple[Source, Selection] | None:
        """Return the first source for which `select` is not empty, and what it selects."""
        return next(((source, selected) for source in self.everyone if (selected := select(source))), None)

    def with_gpu(self) -> Source | None:
        """Return the first source that timed a GPU."""
        return self.first(lambda source: source.has_gpu_times)


def judgements(results: Results, belongs: Callable[[Measure], bool]) -> tuple[list[Measure], tuple[Source, ...]]:
    """Return (the measures accepted by `belongs`, their sources), for measures independent of a machine's speed.

    Such measures are verdicts and outcomes. For each backend and experiment (`finding`), they are from the first source
    whose set is complete: at least FULL of the largest. So a machine without a GPU is combined with one that has a GPU,
    and a user's complete set is preferred to committed ones, but a quick one does not replace them.
    """
    sets: list[tuple[Source, dict[tuple[object, object], list[Measure]]]] = []
    for source in results.everyone:
        by_experiment: dict[tuple[object, object], list[Measure]] = {}
        for measure in filter(belongs, source.measures):
            by_experiment.setdefault(
                (measure.description.get("backend"), measure.description.get("finding")), []
            ).append(measure)
        sets.append((source, by_experiment))
    largest: dict[tuple[object, object], int] = {}
    for _, by_experiment in sets:
        for key, of_set in by_experiment.items():
            largest[key] = max(largest.get(key, 0), _configurations(of_set))
    selected: list[Measure] = []
    sources: list[Source] = []
    for source, by_experiment in sets:
        full = [
            key
            for key, of_set in by_experiment.items()
            if key in largest and _configurations(of_set) >= FULL * largest[key]
        ]
        for key in full:
            del largest[key]
            selected += by_experiment[key]
        if full:
            sources.append(source)
    return selected, tuple(sources)


def _configurations(measures: Iterable[Measure]) -> int:
    return len({measure.configuration for measure in measures})


def provenance(sources: Sequence[Source]) -> str:
    """Return the sources of numbers in a line; empty without sources."""
    return "; ".join(source.provenance for source in sources)


def is_wrong(timing: Timing) -> bool:
    """True if the result of a timed configuration failed its check: such a time does not compete."""
    infinite = timing.error is not None and timing.error == float("inf")
    return infinite or any(map(marks.is_wrong, timing.suspect))


def sound(timings: Iterable[Timing]) -> list[Timing]:
    """Return the timings with a correct state."""
    return [timing for timing in timings if not is_wrong(timing)]


def is_suspect(timing: Timing) -> bool:
    """True if a time is doubtful: noisy, disturbed, or of a result that was not checked."""
    return bool(timing.suspect) or timing.error is None
