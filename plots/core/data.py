"""What figures and lab book draw from: a user's own measurements and the committed ones, machine by machine.

`load` reads stores and text exports; a `Source` is what one machine holds of the sweep and of the accuracy runs. The
sources that a figure is about are `featured`: the user's own, or the committed ones where there are no others.
Committed sources beside own ones are `background`: drawn lightly, and labelled.
"""

from __future__ import annotations

import gc
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench.experiments.accuracy.experiment import STAGE as ACCURACY_STAGE
from bench.measure.energy import STAGE as ENERGY_STAGE
from bench.measure.findings_timing import STAGE as FINDINGS_STAGE
from bench.peers.results import Ratio, ratios
from bench.store.results import Machine, Measure, Store, Timing, canonical, machines, measures, open_readonly, timings

Origin = Store | str | Path
THREAD_WORDS = ("1x", "2x", "4x")
SIMULATOR = "CUDA simulator"  # in a suspect mark: no time of a GPU at all
WRONG = ("wrong answer", "state not finite")  # suspect marks that say more than "noisy"


@dataclass(frozen=True)
class Run:
    """One run of a measuring command. `commit`: source revision or None; `started`: UTC, ISO 8601."""

    commit: str | None
    started: str
    command: str


@dataclass(frozen=True, eq=False)
class Source:
    """What one machine measured. `own`: by the user, else committed with the lab. `timings`: of the sweep, by the
    kernels the lab chose itself, with one threading layer and wait policy (`threading`, the most measured one).
    `scene`: the sweep's, as nested tables without the grid's size. `costs`: of the accuracy runs, by configuration.
    `kernels`: timings of forced kernels; `energies`: samples with joules, by configuration; `defaults`: of forced
    kernels, whether the backend would have chosen them, by configuration. `peers`: what was timed beside the lab.
    `findings`: timings behind single findings (bench/experiments/findings.py), small grids first."""

    machine: Machine
    own: bool
    timings: tuple[Timing, ...]
    measures: tuple[Measure, ...]
    runs: tuple[Run, ...]
    scene: dict[str, Any] = field(default_factory=dict)
    threading: tuple[str | None, str | None] = (None, None)
    costs: dict[str, Timing] = field(default_factory=dict)
    kernels: tuple[Timing, ...] = ()
    energies: dict[str, Timing] = field(default_factory=dict)
    defaults: dict[str, bool] = field(default_factory=dict)
    peers: tuple[Ratio, ...] = ()
    findings: tuple[Timing, ...] = ()

    @property
    def processor(self) -> str:
        """`AMD EPYC, 2 cores`."""
        return self.machine.label.split(";")[0].strip()

    @property
    def gpu(self) -> str | None:
        """The GPU's name; None for a machine without."""
        return self.machine.record.get("gpu")

    @property
    def commit(self) -> str:
        """The revision that was measured last."""
        return next((run.commit for run in reversed(self.runs) if run.commit), "unknown")

    @property
    def date(self) -> str:
        """The day of the last measurement, `2026-11-21`."""
        return self.runs[-1].started[:10] if self.runs else "unknown"

    @property
    def provenance(self) -> str:
        """Machine, commit and date in one line, for captions."""
        committed = "" if self.own else "Committed measurements: "
        return f"{committed}{self.machine.label}; commit {self.commit}, measured {self.date}"

    def select(
        self,
        backend: str,
        word: str | None = None,
        precision: str = "float32",
        *,
        graphics: bool = False,
        square: bool = True,
    ) -> list[Timing]:
        """The sweep's timings of one curve, smallest grid first. `word`: 1x, 2x, 4x or a number; None on the GPU."""
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
        """The timings of every forced kernel at square sizes, smallest first, by kernel. `word`: threads on the CPU."""
        found: dict[str, list[Timing]] = {}
        for timing in self.kernels:
            wanted = timing.thread_word == (None if backend == "gpu" else word)
            if ":" in timing.kernel:  # a tile that was tried out by hand is no rung
                continue
            if wanted and (timing.backend, timing.precision) == (backend, precision) and timing.rows == timing.columns:
                found.setdefault(timing.kernel, []).append(timing)
        return found

    @property
    def has_gpu_times(self) -> bool:
        return any(timing.backend == "gpu" for timing in self.timings)


@dataclass(frozen=True, eq=False)
class Results:
    """All sources, the user's own first. What is found in them is kept with them (functools.lru_cache)."""

    sources: tuple[Source, ...]

    @property
    def featured(self) -> tuple[Source, ...]:
        own = tuple(source for source in self.sources if source.own)
        return own or self.sources

    @property
    def background(self) -> tuple[Source, ...]:
        return tuple(source for source in self.sources if source not in self.featured)

    def with_gpu(self) -> Source | None:
        """The first source that timed a GPU: a featured one, else a committed one."""
        return next((s for s in (*self.featured, *self.background) if s.has_gpu_times), None)


def judgements(results: Results, belongs: Callable[[Measure], bool]) -> tuple[list[Measure], tuple[Source, ...]]:
    """The measures that `belongs` takes and that do not hang on a machine's speed (verdicts, outcomes), and their sources.

    Those of the first source that has any, and for each backend which that one lacks, those of the next one that has it:
    a machine without a GPU is read beside one with.
    """
    found: list[Measure] = []
    sources: list[Source] = []
    for source in (*results.featured, *results.background):
        held = {measure.description.get("backend") for measure in found}
        more = [m for m in source.measures if belongs(m) and m.description.get("backend") not in held]
        if more:
            found += more
            sources.append(source)
    return found, tuple(sources)


def provenance(sources: Sequence[Source]) -> str:
    """Where numbers come from, in a line; nothing for no source."""
    return "; ".join(source.provenance for source in sources)


def is_wrong(timing: Timing) -> bool:
    """Whether the answer of a timed configuration failed its check: such a time wins nothing."""
    infinite = timing.error is not None and timing.error == float("inf")
    return infinite or any(reason.startswith(WRONG) for mark in timing.suspect for reason in mark.split("; "))


def is_suspect(timing: Timing) -> bool:
    """Whether a time is to be read with care: noisy, disturbed, or of an answer that nothing was held against."""
    return bool(timing.suspect) or timing.error is None


@contextmanager
def uncollected() -> Iterator[None]:
    """While a hundred thousand small tables are made that all stay, looking for garbage takes a third of the time."""
    wanted = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if wanted:
            gc.enable()


def load(own: Origin | Sequence[Origin] | None, committed: Iterable[str | Path] = ()) -> Results:
    """Read the user's own store(s) (None: there are none) and the committed text exports. Raises InputError."""
    origins: list[Origin] = [] if own is None else [own] if isinstance(own, Store | str | Path) else list(own)
    found: list[Source] = []
    with uncollected(), ExitStack() as stack:
        for origin in origins:
            store = origin if isinstance(origin, Store) else stack.enter_context(open_readonly(origin))
            found += _sources(store, own=True)
        for path in committed:
            found += _sources(stack.enter_context(open_readonly(path)), own=False)
    found.sort(key=lambda source: (not source.own, not source.has_gpu_times))
    return Results(tuple(found))


def _sources(store: Store, own: bool) -> list[Source]:
    descriptions = {key: json.loads(text) for key, text in store.query("SELECT hash, description FROM configuration")}
    result = []
    for machine in machines(store):
        everything = [
            timing
            for timing in timings(store, machine.key)
            if timing.peer is None and not any(SIMULATOR in mark for mark in timing.suspect)
        ]
        simulated = machine.record.get("gpu_count") is None
        numbers = [
            m
            for m in measures(store, machine=machine.key)
            if not (simulated and m.description["backend"] == "gpu") and m.description.get("peer") is None
        ]
        costs = {timing.configuration: timing for timing in timings(store, machine.key, ACCURACY_STAGE)}
        runs = tuple(
            Run(*row)
            for row in store.query(
                "SELECT commit_hash, started, command FROM run WHERE machine = ? ORDER BY started, rowid",
                (machine.key,),
            )
        )
        scene, everything = _one_family(everything, descriptions)
        threading, everything = _one_threading(everything)
        times = tuple(timing for timing in everything if timing.chosen)
        forced = tuple(timing for timing in everything if not timing.chosen)
        energies = {timing.configuration: timing for timing in timings(store, machine.key, ENERGY_STAGE)}
        defaults = {m.configuration: bool(m.value) for m in numbers if m.name == "default"}
        peers = tuple(ratios(store, machine.key))
        findings = tuple(
            timing
            for timing in timings(store, machine.key, FINDINGS_STAGE)
            if not any(SIMULATOR in mark for mark in timing.suspect)
        )
        if everything or numbers or peers:
            result.append(
                Source(
                    machine,
                    own,
                    times,
                    tuple(numbers),
                    runs,
                    scene,
                    threading,
                    costs,
                    forced,
                    energies,
                    defaults,
                    peers,
                    findings,
                )
            )
    return sorted(result, key=lambda source: source.runs[-1].started if source.runs else "", reverse=True)


def _one_family(times: list[Timing], descriptions: dict[str, Any]) -> tuple[dict[str, Any], list[Timing]]:
    """The timings of the scene that was swept over most sizes: scenes timed at one size are no curve."""

    def family(timing: Timing) -> str:
        scene = json.loads(canonical(descriptions[timing.configuration]["scene"]))
        for table in scene.values():
            if isinstance(table, dict) and "rows" in table:
                del table["rows"], table["columns"]
        return canonical(scene | {"math": descriptions[timing.configuration]["math"]})

    sizes: dict[str, set[tuple[int, int]]] = {}
    for timing in times:
        sizes.setdefault(family(timing), set()).add((timing.rows, timing.columns))
    if not sizes:
        return {}, []
    chosen = max(sizes, key=lambda key: len(sizes[key]))
    scene = json.loads(chosen)
    scene.pop("math")
    return scene, [timing for timing in times if family(timing) == chosen]


def _one_threading(times: list[Timing]) -> tuple[tuple[str | None, str | None], list[Timing]]:
    """The timings of the threading layer and wait policy that were measured most: mixed curves would compare those."""
    count = Counter((timing.layer, timing.wait_policy) for timing in times if timing.backend == "cpu")
    if not count:
        return (None, None), times
    (chosen, _), *_ = count.most_common(1)
    return chosen, [t for t in times if t.backend != "cpu" or (t.layer, t.wait_policy) == chosen]
