"""`softlab sweep --peers`: the lab compared with programs that a user could choose instead.

For every scene and size, each backend and precision is a group: the lab (its own choice of kernel, as many threads as
cores) and every peer that can run the scene here, in one process, sampled in turn (A B C A B C ...). Before a time is
stored, each state is compared with the lab's CPU in float64 `exact` math, at that very size. In the store all of them,
the lab too, are configurations with a `peer`, so that ordinary figures and tables do not use them. Resumable, safe
under Ctrl-C; a peer that is not installed is skipped with its reason.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from softlab.bench.experiments.sweep import backends_here, choose_effort
from softlab.bench.measure.cases import Effort, SweepSummary, record_skip
from softlab.bench.measure.machine import enter_machine, gpu_simulated
from softlab.bench.measure.progress import progress_bar
from softlab.bench.measure.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from softlab.bench.peers.answers import Judge
from softlab.bench.peers.base import Opened, Peer
from softlab.bench.peers.cases import Beside, PeerCase, group_of
from softlab.bench.peers.registry import OURS, PEERS
from softlab.bench.peers.scenes import peer_scenes
from softlab.bench.store.database import Store
from softlab.bench.store.versions import code_version
from softlab.model.base.memory import available_bytes, readable
from softlab.model.core.build import Body, build
from softlab.model.core.simulation import Simulation


def run_peers(
    store: Store,
    *,
    quick: bool = False,
    scenes: Iterable[str] | None = None,
    backends: Sequence[str] | None = None,
    sizes: Iterable[int] | None = None,
    precisions: Sequence[str] = ("float32", "float64"),
    max_seconds: float | None = None,
    total_seconds: float | None = None,
    repeats: int | None = None,
    min_seconds: float | None = None,
    peers: Sequence[Peer] = PEERS,
    progress: bool = True,
    command: str = "softlab sweep --peers",
) -> SweepSummary:
    """Measure the comparisons that the store lacks, and return a summary.

    `scenes`: words of bench/peers/scenes.py; other arguments as in run_sweep of bench/experiments/sweep.py.

    Raises SceneError (an impossible choice), InputError (the store), BackendUnavailable (a requested backend).
    """
    begin = time.perf_counter()
    effort = choose_effort(quick, max_seconds, total_seconds, repeats, min_seconds)
    chosen = backends_here(backends)
    lengths = None if sizes is None else list(sizes)
    wanted_scenes = peer_scenes(scenes, quick)
    planned = [(scene, sized) for scene in wanted_scenes for sized in scene.sized(quick, lengths)]
    peers = [peer for peer in peers if any(scene.word in peer.scenes for scene in wanted_scenes)]
    revision = code_version()
    summary = SweepSummary(enter_machine(store), "")
    comparison = _Comparison(store, effort, summary, begin, peers)
    wanted = list(backends or ("cpu", "gpu"))  # peers of an unavailable backend are skipped with their reason
    groups = []
    for scene, sized in planned:
        groups += [group_of(scene, sized, name, precision, peers) for name in wanted for precision in precisions]
    try:
        comparison.run(groups, chosen, command, revision, progress)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.seconds = time.perf_counter() - begin
    return summary


class _Comparison:
    """State of one comparison."""

    def __init__(self, store: Store, effort: Effort, summary: SweepSummary, begin: float, peers: Sequence[Peer]):
        self.store, self.effort, self.summary, self.begin = store, effort, summary, begin
        self._here = {peer.name: peer.available() for peer in peers}
        self._costs: dict[tuple[Any, ...], tuple[int, float]] = {}  # kind -> (particles, seconds per step)
        self._compiled: set[tuple[Any, ...]] = set()
        self._judge = Judge(store, summary, effort.max_seconds)
        self._neighbours = Neighbours()

    def run(
        self,
        groups: Sequence[Sequence[PeerCase]],
        backends: Sequence[str],
        command: str,
        revision: str | None,
        show: bool,
    ) -> None:
        able: list[list[PeerCase]] = []
        refused: list[tuple[PeerCase, str]] = []
        for group in groups:
            reasons = [self._refusal(case, backends) for case in group]
            refused += [(case, reason) for case, reason in zip(group, reasons, strict=True) if case.peer and reason]
            runnable = [case for case, reason in zip(group, reasons, strict=True) if not reason]
            if not any(self._missing(case) for case in runnable):
                self.summary.stored += len(runnable)
            elif len(runnable) > 1:  # the lab alone is no comparison
                able.append(runnable)
        if not able:
            self.summary.skipped += [(str(case), reason) for case, reason in refused]
            return
        self.summary.run = self.store.start_run(self.summary.machine, command, revision)
        for case, reason in refused:
            record_skip(self.store, self.summary, case, reason)
        with progress_bar(show) as bar:
            task = bar.add_task("peers", total=sum(map(len, able)))
            for group in able:
                self.measure(group, lambda text: bar.update(task, description=text))
                bar.advance(task, len(group))

    def _refusal(self, case: PeerCase, backends: Sequence[str]) -> str | None:
        if case.peer is None:
            return None if case.backend in backends else f"no {case.backend} here"
        available, text = self._here[case.peer.name]
        if not available:
            return f"{case.peer.label}: {text}"
        if case.backend not in backends or (case.backend == "gpu" and gpu_simulated()):
            return f"{case.peer.label}: the lab has no {case.backend} here to be held beside"
        reason = case.peer.refusal(case.scene)
        return f"{case.peer.label}: {reason}" if reason else None

    def _missing(self, case: PeerCase) -> int:
        stored = self.store.sample_count(case.description, self.summary.machine, case.sources)
        return max(0, self.effort.repeats - stored)

    def _skip(self, case: PeerCase, reason: str) -> None:
        record_skip(self.store, self.summary, case, reason)

    # ------------------------------------------------------------------ one group

    def measure(self, group: Sequence[PeerCase], report: Callable[[str], None]) -> None:
        """Open, check and time the cases of one group; the lab is measured again next to a peer that is missing."""
        lacking = [case for case in group[1:] if self._missing(case)] or list(group[1:])
        affordable = self._affordable([group[0], *lacking])
        if len(affordable) < 2 or affordable[0].peer is not None:
            return
        body = build(group[0].scene)
        with ExitStack() as stack:
            subjects: list[Subject] = []
            warnings: list[str | None] = []  # of each subject
            for case in affordable:
                try:
                    report(f"{case}: opening")
                    simulation = self._open(case, body, stack)
                    report(f"{case}: checking")
                    warning = self._judge.check(case, simulation, body)
                    report(f"{case}: warming up")
                    subject = self._warmed(case, simulation)
                except Exception as error:  # a peer may fail in any way; the others continue
                    self._skip(case, f"{case.peer.label if case.peer else OURS}: {error or type(error).__name__}")
                    continue
                if isinstance(subject, str):
                    self._skip(case, subject)
                    continue
                subjects.append(subject)
                warnings.append(warning)
            if len(subjects) < 2 or subjects[0].name.peer is not None:
                return
            try:
                self._sample(subjects, warnings, report)
            except Exception as error:
                for subject in subjects:
                    self._skip(subject.name, f"stopped while this size was sampled: {error or type(error).__name__}")

    def _affordable(self, cases: list[PeerCase]) -> list[PeerCase]:
        affordable: list[PeerCase] = []
        free, used = available_bytes(), 0
        for case in cases:
            left = math.inf
            if self.effort.total_seconds:
                left = self.effort.total_seconds - (time.perf_counter() - self.begin)
            needed = self._estimate(case)
            if left <= 0 or needed > left:
                self._skip(case, f"the sweep's {self.effort.total_seconds:g} s are used up")
            elif needed > self.effort.max_seconds:
                self._skip(case, f"estimated to take {needed:.0f} s, over --max-seconds {self.effort.max_seconds:g}")
            elif used + case.host_bytes > 0.8 * free:
                left_bytes = readable(max(0, int(0.8 * free) - used))
                self._skip(case, f"needs {readable(case.host_bytes)} of main memory, of which {left_bytes} may be used")
            else:
                used += case.host_bytes
                affordable.append(case)
        return affordable

    def _estimate(self, case: PeerCase) -> float:
        """Return the time [s] of the check and all repeats, from the last size; 0 if unknown."""
        particles, seconds = self._costs.get(case.kind, (case.particles, 0.0))
        one = seconds * max(1.0, case.particles / particles)
        repeats = (self.effort.repeats + 2) * max(one, self.effort.min_seconds if seconds else 0.0)
        return case.steps_checked * one + repeats

    def _open(self, case: PeerCase, body: Body, stack: ExitStack) -> Simulation | Beside:
        """Open and compile; the first of its kind in this process is timed."""
        begin = time.perf_counter()
        simulation: Simulation | Beside
        if case.peer is None:
            simulation = stack.enter_context(case.open())
        else:
            opened = case.peer.open(case.scene, case.precision, case.threads or 1)
            stack.callback(_close_quietly, opened)
            simulation = Beside(case.peer, opened, body)
        first = time.perf_counter() - begin + self._one_step(simulation)
        if case.kind not in self._compiled:
            self._compiled.add(case.kind)
            simulation.reset()
            seconds = max(0.0, first - self._one_step(simulation))
            self.summary.compile_seconds += seconds
            if not self.store.sample_count(case.description, self.summary.machine, case.sources, "compile"):
                self.store.add_sample(self.summary.run, case.description, case.sources, seconds, 0, stage="compile")
        self.store.add_measure(self.summary.run, case.description, case.sources, "kernel", None, "", simulation.kernel)
        return simulation

    @staticmethod
    def _one_step(simulation: Simulation | Beside) -> float:
        begin = time.perf_counter()
        simulation.advance(1)
        simulation.synchronize()
        return time.perf_counter() - begin

    def _warmed(self, case: PeerCase, simulation: Simulation | Beside) -> Subject | str:
        """Return the subject with the number of steps per sample, or the reason why it takes too long."""
        subject = Subject(simulation, case)  # type: ignore[arg-type]  # a peer has all attributes that timing needs
        warm_up(subject)
        needed = (self.effort.repeats + 1) * (subject.seconds_per_step + subject.restore_seconds)
        self._costs[case.kind] = (case.particles, subject.seconds_per_step)
        if needed > self.effort.max_seconds:
            return f"would take {needed:.0f} s, over --max-seconds {self.effort.max_seconds:g}"
        most = self.effort.max_seconds / (self.effort.repeats + 2) - subject.restore_seconds
        choose_steps(subject, self.effort.min_seconds, most)
        return subject

    def _sample(
        self, subjects: Sequence[Subject], warnings: Sequence[str | None], report: Callable[[str], None]
    ) -> None:
        """Sample in turn; each sample is written to disk before the next one starts."""
        wanted = [max(1, self._missing(subject.name)) for subject in subjects]
        wanted[0] = max(wanted)
        taken: list[list[float]] = [[] for _ in subjects]
        places = {id(subject): place for place, subject in enumerate(subjects)}
        for subject, sample in interleaved(subjects, wanted, self._neighbours):
            case, place = subject.name, places[id(subject)]
            suspect = "; ".join(filter(None, (sample.suspect, warnings[place]))) or None
            self.store.add_sample(
                self.summary.run, case.description, case.sources, sample.seconds, sample.steps, suspect=suspect
            )
            taken[place].append(sample.seconds / sample.steps)
            self.summary.samples += 1
            self.summary.suspect += suspect is not None
            report(f"{case}: {statistics.median(taken[place]) * 1e6:.3g} us a step")
        for subject, seconds in zip(subjects, taken, strict=True):
            self._costs[subject.name.kind] = (subject.name.particles, statistics.median(seconds))
        self.summary.measured += len(subjects)


def _close_quietly(opened: Opened) -> None:
    with suppress(Exception):  # a device that failed while stepping fails here again; the reason is stored already
        opened.close()
