"""Measuring one group of a sweep: the configurations of one grid that are interleaved.

Each simulation is opened once, checked (bench/experiments/checks.py), warmed up, and then sampled in turn with the others;
every number is stored before the next one is measured.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from typing import Protocol, TypeVar

from softlab.app.driver import open_simulation
from softlab.bench.experiments.checks import FULL_SIZE_STEPS, Check, against_other, against_reference
from softlab.bench.measure.cases import Case, Costs, Effort, Kind, SweepSummary, record_skip
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.experiment import store_measures
from softlab.bench.measure.gpu import gpu_or_reason, gpu_simulated
from softlab.bench.measure.samples import stored_samples
from softlab.bench.measure.timing import Neighbours, Renderer, Sample, Subject, choose_steps, interleaved, warm_up
from softlab.bench.store.database import Store
from softlab.cpu_backend.core.threads import thread_count
from softlab.model.base.errors import Diverged, SoftlabError
from softlab.model.core.simulation import Simulation


class Closable(Protocol):
    """A resource that was opened."""

    def close(self) -> None: ...


Closed = TypeVar("Closed", bound=Closable)
DRAWN_BY = "drawn_by"  # a measure: renderer, picture and way, as its reason
PICTURE = (800, 600)  # pixels of what is drawn off-screen: the grid alone, no text


def close_quietly(stack: ExitStack, opened: Closed) -> Closed:
    """Close what was opened with the stack; a device that failed while stepping fails again, for a reason that is stored."""

    def close() -> None:
        with suppress(Exception):
            opened.close()

    stack.callback(close)
    return opened


class GroupRunner:
    """Measures groups of cases into the store, one group at a time. `report(text)` receives the current step.

    `costs` collects the duration of each kind of case. `backends`: those that may be opened for a comparison.
    """

    refusals: tuple[type[Exception], ...] = (SoftlabError, MemoryError)  # what ends a case, not the sweep

    def __init__(
        self,
        store: Store,
        effort: Effort,
        summary: SweepSummary,
        backends: Sequence[str],
        costs: Costs,
        report: Callable[[str], None] = lambda text: None,
    ):
        self.store, self.effort, self.summary = store, effort, summary
        self.backends, self.costs, self.report = backends, costs, report
        self._neighbours = Neighbours()
        self._compiled: set[Kind] = set()

    def measure(self, group: Sequence[Case]) -> None:
        """Check and time the cases of one group, all of one grid."""
        with ExitStack() as stack:
            simulations: dict[Kind, Simulation] = {}
            refused: dict[Kind, str] = {}
            for case in group:
                kind = case.simulation_kind
                if kind not in simulations and kind not in refused:
                    try:
                        simulations[kind] = self._open(case, stack)
                    except self.refusals as error:
                        refused[kind] = self._reason(case, error)
                        self._diverged(case, error)
                if kind in refused:
                    record_skip(self.store, self.summary, case, refused[kind])
            opened = [case for case in group if case.simulation_kind in simulations]
            warnings = self._check(opened, simulations)
            subjects = self._subjects(opened, simulations, stack)
            self._sample(subjects, warnings)

    # ------------------------------------------------------------------ opening

    def _open(self, case: Case, stack: ExitStack) -> Simulation:
        """Open a simulation and compile its kernels; the compilation of the first of its variant in this process is timed."""
        self.report(f"{case}: opening")
        begin = time.perf_counter()
        simulation = self._enter(case, stack)
        first = time.perf_counter() - begin + self._first_steps(simulation)
        variant = self._variant(case, simulation)
        if variant not in self._compiled:
            self._compiled.add(variant)
            begin = time.perf_counter()
            simulation.rewind()
            again = time.perf_counter() - begin + self._first_steps(simulation)
            seconds = max(0.0, first - again)
            self.summary.compile_seconds += seconds
            if not self.store.sample_count(case.description, self.summary.machine, case.sources, "compile"):
                self.store.add_sample(self.summary.run, case.description, case.sources, seconds, 0, stage="compile")
        simulation.rewind()  # to the start, which opening put aside
        return simulation

    def _enter(self, case: Case, stack: ExitStack) -> Simulation:
        """Simulation of a case, closed with the stack."""
        return stack.enter_context(case.open())

    def _variant(self, case: Case, simulation: Simulation) -> Kind:
        """Return the key of simulations that use the same machine code."""
        return (case.backend, case.precision, simulation.kernel)

    def _reason(self, case: Case, error: BaseException) -> str:
        return str(error) or type(error).__name__

    @staticmethod
    def _first_steps(simulation: Simulation) -> float:
        begin = time.perf_counter()
        simulation.advance(1)
        simulation.check(snapshot=False)
        simulation.synchronize()
        return time.perf_counter() - begin

    def _diverged(self, case: Case, error: BaseException) -> None:
        """Store the infinite error of a configuration that breaks."""
        if isinstance(error, Diverged):
            self._store(case, {"error": (math.inf, "spacing", str(error))})

    def _store(self, case: Case, numbers: Measures) -> None:
        store_measures(self.store, self.summary.run, case.description, case.sources, numbers)

    # ------------------------------------------------------------------ checking

    def _check(self, cases: Sequence[Case], simulations: dict[Kind, Simulation]) -> dict[Kind, str]:
        """Store the errors of every case; return the marks of its samples, by kind of simulation."""
        machine = self.summary.machine
        warnings: dict[Kind, str] = {}
        for kind, simulation in simulations.items():
            members = [case for case in cases if case.simulation_kind == kind]
            is_stored = all(self.store.has_measure(c.description, machine, c.sources, "difference") for c in members)
            self.report(f"{members[0]}: checking")
            reference = against_reference(simulation)  # in milliseconds, so that every process asks anew
            other: Check | str | None = None if is_stored else self._other_check(members[0], simulation, simulations)
            simulation.reset()
            for case in members:
                self._store_checks(case, simulation.kernel, reference, other)
            for check in (reference, other):
                if isinstance(check, Check) and not check.good:
                    warnings[kind] = f"wrong answer: {check.error:.2g} spacings off ({check.note})"
                    self.summary.wrong.append((str(members[0]), warnings[kind]))
        return warnings

    def _other_check(self, case: Case, simulation: Simulation, simulations: dict[Kind, Simulation]) -> Check | str:
        """Check against the other backend at the same size, or the reason why there is none."""
        name = "gpu" if case.backend == "cpu" else "cpu"
        if name not in self.backends:
            available, text = gpu_or_reason()
            missing = name == "gpu" and (not available or gpu_simulated())
            return f"no other backend to compare with: {text if missing else f'{name} was not asked for'}"
        for kind, other in simulations.items():
            if kind[0] == name and kind[2] == case.precision:
                return against_other(simulation, other)
        threads = thread_count("1x") if name == "cpu" else None
        particles, seconds, _ = self.costs.get((name, threads, case.precision, None, False), (case.particles, 0.0, 0.0))
        needed = seconds * case.particles / particles * FULL_SIZE_STEPS
        if needed > self.effort.max_seconds:
            return f"the {name} would take about {needed:.0f} s for {FULL_SIZE_STEPS} steps of this size"
        try:
            with open_simulation(case.scene, name, precision=case.precision) as witness:
                return against_other(simulation, witness)
        except (SoftlabError, MemoryError) as error:
            return f"the {name} cannot run this size: {error}"

    def _store_checks(self, case: Case, kernel: str, reference: Check, other: Check | str | None) -> None:
        numbers: Measures = {"kernel": (None, "", kernel)}
        for name, check in (("error", reference), ("difference", other)):
            if isinstance(check, Check):
                numbers[name] = check.error, "spacing", check.note
                numbers[f"{name}_largest"] = check.largest, "spacing", check.note
            elif check is not None:
                numbers[name] = None, "spacing", check
        self._store(case, numbers)

    # ------------------------------------------------------------------ timing

    def _subjects(self, cases: Sequence[Case], simulations: dict[Kind, Simulation], stack: ExitStack) -> list[Subject]:
        """Return the subjects that can be timed, warmed up, with the steps of a sample chosen."""
        renderer: Renderer | str | None = None
        subjects = []
        for case in cases:
            if case.simulation_kind not in simulations:
                continue  # it failed its check
            if case.graphics and renderer is None:
                renderer = self._renderer(case, stack)
            if case.graphics and isinstance(renderer, str):
                record_skip(self.store, self.summary, case, renderer)
                continue
            self.report(f"{case}: warming up")
            drawn = renderer if case.graphics and not isinstance(renderer, str) else None
            subject = Subject(simulations[case.simulation_kind], case, drawn)
            try:
                warm_up(subject)
                if drawn is not None:
                    self._store_drawing(case, drawn)
                least = subject.restore_seconds + subject.seconds_per_step * case.least_steps
                needed = (self.effort.repeats_of(case) + 1) * least
                self.costs[case.kind] = (case.particles, subject.seconds_per_step, subject.restore_seconds)
                if needed > self.effort.max_seconds:
                    reason = f"would take {needed:.0f} s, over --max-seconds {self.effort.max_seconds:g}"
                    record_skip(self.store, self.summary, case, reason)
                    continue
                most = self.effort.max_seconds / (self.effort.repeats_of(case) + 2) - subject.restore_seconds
                choose_steps(subject, self.effort.min_seconds, most)
            except self.refusals as error:
                self._diverged(case, error)
                record_skip(self.store, self.summary, case, self._reason(case, error))
                continue
            subjects.append(subject)
        return subjects

    def _store_drawing(self, case: Case, drawn: Renderer) -> None:
        """Store the renderer, the size of the picture and the path of the state to the drawing."""
        who, path = (getattr(drawn, name, "unknown") for name in ("renderer", "transfer"))
        self._store(case, {DRAWN_BY: (None, "", f"{who}, {PICTURE[0]} x {PICTURE[1]} pixels, {path}")})

    def _renderer(self, case: Case, stack: ExitStack) -> Renderer | str:
        """Renderer of the group (two off-screen contexts cannot coexist), or the reason why there is none."""
        try:
            from softlab.app.output.offscreen import OffscreenRenderer

            return stack.enter_context(OffscreenRenderer(case.scene, *PICTURE, legend=False))
        except (SoftlabError, ImportError, MemoryError) as error:
            return f"no off-screen drawing: {error}"

    def _interleaved(self, subjects: Sequence[Subject], wanted: Sequence[int]) -> Iterator[tuple[Subject, Sample]]:
        return interleaved(subjects, wanted, self._neighbours, self.effort.again)

    def _wanted(self, subjects: Sequence[Subject]) -> list[int]:
        """Return the number of samples that each subject lacks."""
        machine, cases = self.summary.machine, [subject.name for subject in subjects]
        return [
            self.effort.repeats_of(case) - self.store.sample_count(case.description, machine, case.sources)
            for case in cases
        ]

    def _sample(self, subjects: Sequence[Subject], warnings: dict[Kind, str]) -> None:
        """Sample the subjects in turn; each sample is on disk before the next one starts."""
        summary, store = self.summary, self.store
        wanted = self._wanted(subjects)
        taken: dict[int, list[float]] = {id(subject): [] for subject in subjects}
        samples = self._interleaved(subjects, wanted)
        for subject, sample in stored_samples(
            store, summary.run, "step", samples, warning=lambda case: warnings.get(case.simulation_kind)
        ):
            taken[id(subject)].append(sample.seconds / sample.steps)
            summary.samples += 1
            summary.suspect += sample.suspect is not None
            self.report(f"{subject.name}: {statistics.median(taken[id(subject)]) * 1e6:.3g} us a step")
        for subject in subjects:
            if taken[id(subject)]:
                summary.measured += 1
                case = subject.name
                self.costs[case.kind] = (case.particles, statistics.median(taken[id(subject)]), subject.restore_seconds)
