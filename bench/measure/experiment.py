"""The frame of every experiment: keys of configurations, measurement of those that the store lacks, and the summary.

An experiment is groups of cases, which are sampled in turn, and a function that measures a group. `resume` does the rest: it
skips what the store has, and owns the run, the bar and Ctrl-C. `store_measures` stores numbers,
bench/measure/samples.py samples.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Self, TypedDict, TypeVar

from softlab.bench.keys.enter import enter_keys, same_kernels
from softlab.bench.measure.compile_ahead import Job, compilations, do_ahead
from softlab.bench.measure.gpu import gpu_or_reason, gpu_simulated
from softlab.bench.measure.machine import enter_machine
from softlab.bench.measure.partition import current_partition, is_alone
from softlab.bench.measure.progress import progress_bar
from softlab.bench.measure.timing import MEASUREMENT
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration
from softlab.bench.store.schema import SAME, Description, configuration_hash
from softlab.bench.store.versions import code_version, digest_of
from softlab.cpu_backend.core.threads import thread_count, threading_layer, wait_policy
from softlab.model.base.errors import BackendUnavailable, SceneError
from softlab.model.scene.scene import Scene

# ---------------------------------------------------------------------- what is measured, and where


def source_hash(backend: str) -> str:
    """Hash of a backend's sources, of the formulas, and of the definition of a sample."""
    return f"{digest_of(backend)}-{MEASUREMENT}"


class Host(TypedDict, total=False):
    """The entries of a configuration for its host; for a GPU none."""

    threads: int
    layer: str
    wait_policy: str


def host_of(backend: str, threads: str | int = "1x") -> Host:
    """Return the entries of a configuration for its host: `threads` as requested, and more; for a GPU none."""
    if backend != "cpu":
        return {}
    return {"threads": thread_count(threads), "layer": threading_layer(), "wait_policy": wait_policy()}


def backends_here(wanted: Sequence[str] | None) -> list[str]:
    """Return the backends to measure: the requested ones, else all of this machine (a simulated GPU only on request).

    Raises SceneError for an unknown one, BackendUnavailable for a requested one that is missing.
    """
    available, text = gpu_or_reason()
    if wanted is None:
        return ["cpu", "gpu"] if available and not gpu_simulated() else ["cpu"]
    for name in wanted:
        if name not in ("cpu", "gpu"):
            raise SceneError("--backend", name, "must be one of cpu, gpu")
        if name == "gpu" and not available:
            missing, _, remedy = text.partition("; ")
            raise BackendUnavailable(missing, remedy or "run without --backend gpu")
    return list(dict.fromkeys(wanted))


def described(scene: Scene, backend: str, finding: str, **how: Any) -> Description:
    """Return the configuration of an experiment: the usual entries, its finding and the fields that it varies."""
    known = {name: how.pop(name) for name in ("precision", "math", "kernel") if name in how}
    return configuration(scene, backend=backend, **host_of(backend), **known) | {"finding": finding} | how


# ---------------------------------------------------------------------- what was done


@dataclass
class Summary:
    """Result of an experiment, `name`. `machine`, `run`: keys in the store (`run` empty: nothing was to do); cases `measured`
    now, and `stored` from before; `seconds` of wall time since `begin` (of time.perf_counter); `interrupted` by
    Ctrl-C; `version`: of the code (bench/store/versions.py)."""

    machine: str
    run: str = ""
    name: str = ""
    measured: int = 0
    stored: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    begin: float = field(default_factory=time.perf_counter, repr=False, compare=False)
    version: str | None = field(default=None, repr=False, compare=False)

    @classmethod
    def begun(cls, store: Store, name: str) -> Self:
        """Return the summary of an experiment that begins now, and enter this machine into the store. Raises InputError."""
        begin, version = time.perf_counter(), code_version()  # before any thread runs
        return cls(enter_machine(store), name=name, begin=begin, version=version)

    def start(self, store: Store, command: str) -> str:
        """Start a run for the present measurements, unless there is one; return its key."""
        self.run = self.run or store.start_run(self.machine, command, self.version)
        return self.run

    def stop(self) -> None:
        """Record the time so far."""
        self.seconds = time.perf_counter() - self.begin

    def counts(self, done: str = "measured") -> str:
        """`3 measured, 2 already in the store, 7 s`."""
        return f"{self.measured} {done}, {self.stored} already in the store, {self.seconds:.0f} s"

    def ending(self, before: str = "; ") -> str:
        """Return the message about Ctrl-C if that was the end, else nothing."""
        return f"{before}interrupted: the same command resumes" if self.interrupted else ""

    def __str__(self) -> str:
        return f"{self.name}: {self.counts()}{self.ending()}"


One = TypeVar("One")
SummaryType = TypeVar("SummaryType", bound=Summary)
Report = Callable[[str, float], None]  # the current step in words, and the progress of the bar since the last report


@contextmanager
def ending_cleanly(summary: Summary) -> Iterator[None]:
    """Turn Ctrl-C inside this context into `summary.interrupted`; record the time in `summary` in any case."""
    try:
        yield
    except KeyboardInterrupt:
        summary.interrupted = True
    finally:
        summary.stop()


def group_name(place: int, group: Sequence[object]) -> str:
    """Return the name of a group for all processes of an experiment: its place in the plan and a digest of its cases."""
    words = re.sub(r" at 0x\w+", "", " ".join(map(str, group)))  # where something lies in memory names nothing
    return f"{place}-{hashlib.sha256(words.encode()).hexdigest()[:8]}"


def resume(
    store: Store,
    summary: SummaryType,
    groups: Sequence[Sequence[One]],
    is_stored: Callable[[One], bool],
    measure: Callable[[Sequence[One], Report], None],
    *,
    progress: bool,
    command: str,
    worth: Callable[[One], float] = lambda case: 1,
    whole: bool = False,
    before: Callable[[Sequence[One]], Iterable[Job]] = lambda missing: (),
) -> SummaryType:
    """Measure the cases that the store lacks, group by group, in a run of its own, and return the summary.

    One of several workers (bench/measure/partition.py) measures the groups that it takes. Ctrl-C ends cleanly. Raises
    InputError (the store) and the errors of `measure`.

    `is_stored(case)`: the store has it; `measure(group, report)`: measures the cases of a group that it lacks, or (`whole`)
    the whole group; `worth(case)`: its length on the bar, which `progress` shows; `before(cases)`: jobs beside compiling to
    be done before these cases are measured, where no other process measures.
    """

    def lacking(group: Sequence[One]) -> Sequence[One]:
        lacks = [case for case in group if not is_stored(case)]
        return group if whole and lacks else lacks

    with ending_cleanly(summary):
        missing = [lacking(group) for group in groups]
        if _take_same(store, summary, [case for group in missing for case in group], command):
            missing = [lacking(group) for group in groups]
        summary.stored = sum(map(len, groups)) - sum(map(len, missing))
        named = {group_name(k, group): k for k, group in enumerate(groups) if missing[k]}
        worths = {name: sum(worth(case) for case in missing[k]) for name, k in named.items()}
        plan = {name: (worths[name], str(groups[k][0])) for name, k in named.items()}
        current_partition().planned(store, summary.machine, plan)
        cases = [case for group in missing for case in group]
        do_ahead([*(before(cases) if is_alone() else ()), *compilations(cases)], progress)
        with progress_bar(progress and bool(named)) as bar:
            task = bar.add_task(summary.name, total=sum(worths.values()) or 1)
            for name, k in named.items():
                with current_partition().take(name) as taken:
                    group = lacking(groups[k]) if taken else []  # anew: others may have measured some of it since
                    if group:
                        summary.start(store, command)
                        measure(group, lambda text, done: bar.update(task, description=text, advance=done))
        if summary.run:
            enter_keys(store, summary.run, summary.name)
    return summary


def _take_same(store: Store, summary: Summary, cases: Sequence[Any], command: str) -> bool:
    """Enter which of the cases were measured with other sources of the same kernels; True if any was."""
    configurations = [(one, case.sources) for case in cases if hasattr(case, "sources") for one in _descriptions(case)]
    same = same_kernels(store, summary.machine, configurations, summary.name)
    if not same:
        return False
    run = store.start_run(summary.machine, command, summary.version)
    with store.transaction():
        for description, sources in configurations:
            name = configuration_hash(description)
            if same.get(name, ("",))[0] == sources:
                store.add_measure(run, description, sources, SAME, None, "", same[name][1])
    return True


def _descriptions(case: Any) -> Sequence[Description]:
    """Return the configurations of a case, or of a group that is measured as one."""
    return getattr(case, "descriptions", None) or [case.description]


# ---------------------------------------------------------------------- what goes into the store


def store_measures(
    store: Store,
    run: str,
    description: Description,
    sources: str,
    numbers: Mapping[str, tuple[float | None, str, str | None]],
) -> None:
    """Put the numbers of a configuration, name -> value, unit, reason, into the store, all or none."""
    with store.transaction():
        for name, (value, unit, reason) in numbers.items():
            store.add_measure(run, description, sources, name, value, unit, reason)
