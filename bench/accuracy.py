"""Speed against error: every integrator, step size, precision and backend on scenes with a converged reference.

Scenes S1 (`lab-curtain`) and S2 (`lab-hammock`) run to 1.5 s, a time at which a perturbation has not yet grown (the
damped net contracts), so that the distance to the reference means something. Reference: RK4 at h and h/2 with
Richardson extrapolation in NumPy float64 (bench/reference/), with its own error estimate; a point under ten times that
is marked as not resolved. Runs that diverge are points with an infinite error and a reason: where a method breaks is a
result.

The hand-out's step is held against Newton's law like all others, and beside it against x'' = a / 2, which it solves.

Error and time of one configuration are had from the same opened simulation; times as bench/timing.py says. Practice:
Hairer and Wanner, "Solving ODEs II", IV.10; SciML's work-precision diagrams.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.driver import open_simulation
from bench.accuracy_points import (
    COST,
    END,
    ENERGY,
    ENERGY_OFF,
    ERROR,
    ESTIMATE,
    HALF,
    LARGEST,
    SCENES,
    STRAIN,
    UNRESOLVED,
    AccuracyPoint,
    AccuracySummary,
    pareto_front,
    point,
)
from bench.judge import distance
from bench.machine import enter_machine, gpu_simulated, source_revision
from bench.reference import cache
from bench.results import configuration, measures
from bench.store import Store, configuration_hash
from bench.sweep import backends_here, source_hash
from bench.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from cpu_backend.threads import thread_count, threading_layer, wait_policy
from model.digest import source_digest
from model.energy import energies, spring_strain
from model.errors import Diverged
from model.integrators import INTEGRATORS
from model.scene import Scene, load_scene
from model.simulation import PRECISIONS, Simulation

__all__ = ["AccuracyPoint", "AccuracySummary", "pareto_front", "run_accuracy"]

STEP_SIZES = (0.02, 0.01, 0.005, 0.0025)  # s
HALF_ACCELERATION = 2.0  # inertia of the equation that the hand-out's step converges to
RESOLVED = 10  # an error under so many times the reference's own is not resolved
STAGE = "accuracy"  # of the samples in the store, apart from the sweep's


@dataclass(frozen=True)
class Effort:
    """`repeats` samples of `min_seconds` [s]; `max_seconds`: the most of one sample."""

    repeats: int
    min_seconds: float
    max_seconds: float


QUICK = Effort(3, 0.015, 0.5)
FULL = Effort(7, 0.1, 5.0)


@dataclass(frozen=True)
class Case:
    """One configuration to judge, and the description and source hash by which the store knows it."""

    label: str
    scene: Scene
    backend: str
    precision: str
    description: dict[str, Any]
    sources: str

    @property
    def steps(self) -> int:
        return round(END / self.scene.method.dt)

    def __str__(self) -> str:
        method = self.scene.method
        return f"{self.label} {method.integrator} dt {method.dt:g} {self.precision} {self.backend}"

    def open(self) -> Simulation:
        return open_simulation(self.scene, self.backend, precision=self.precision, allow_unstable=True)


def cases(scenes: Sequence[str], backends: Sequence[str]) -> list[Case]:
    """Each scene x backend x precision x integrator x step size, in the order they are measured."""
    judge = source_digest(Path(cache.__file__).parent)
    found = []
    for label in scenes:
        base = load_scene(SCENES[label])
        for backend in backends:
            host: dict[str, Any] = {}
            if backend == "cpu":
                host = {"threads": thread_count("1x"), "layer": threading_layer(), "wait_policy": wait_policy()}
            for precision in PRECISIONS:
                for integrator in INTEGRATORS:
                    for dt in STEP_SIZES:
                        scene = base.replace({"method.integrator": integrator, "method.dt": dt})
                        description = configuration(scene, backend=backend, precision=precision, **host)
                        sources = f"{source_hash(backend)}-{judge}"
                        found.append(Case(label, scene, backend, precision, description, sources))
    return found


def run_accuracy(
    store: Store,
    *,
    quick: bool = False,
    backends: Sequence[str] | None = None,
    scenes: Sequence[str] = tuple(SCENES),
    progress: bool = True,
    command: str = "softlab accuracy",
) -> AccuracySummary:
    """Judge what the store lacks of the grid of cases, and return all of its points.

    `quick`: the same cases with fewer and shorter samples. `backends`: cpu, gpu (None: all that are here). References
    are kept in the folder `references` beside the store. Every number is on disk when it is had; Ctrl-C ends cleanly.

    Raises SceneError (an unknown backend), BackendUnavailable (one asked for that is not here), InputError (the store).
    """
    begin = time.perf_counter()
    effort = QUICK if quick else FULL
    chosen = backends_here(backends)
    revision = source_revision()
    summary = AccuracySummary(enter_machine(store))
    everything = cases(scenes, chosen)
    missing = [case for case in everything if not _held(store, case, summary.machine, effort)]
    summary.held = len(everything) - len(missing)
    try:
        if missing:
            summary.run = store.start_run(summary.machine, command, revision)
            _measure_all(store, summary, missing, effort, progress)
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.points = _points(store, summary.machine, everything)
    summary.seconds = time.perf_counter() - begin
    return summary


def _held(store: Store, case: Case, machine: str, effort: Effort) -> bool:
    return store.has_measure(case.description, machine, case.sources, COST) and (
        store.sample_count(case.description, machine, case.sources, STAGE) >= effort.repeats
    )


def _measure_all(store: Store, summary: AccuracySummary, missing: list[Case], effort: Effort, show: bool) -> None:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(None), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not show, transient=True) as bar:
        task = bar.add_task("accuracy", total=2 * len(missing))

        def tell(text: str, advance: int) -> None:
            bar.update(task, description=text, advance=advance)

        groups: dict[tuple[str, str], list[Case]] = {}
        for case in missing:
            groups.setdefault((case.label, case.backend), []).append(case)
        for group in groups.values():
            _Group(store, summary, effort, tell).measure(group)


class _Group:
    """The cases of one scene and backend: judged one after another, then sampled in turn."""

    def __init__(self, store: Store, summary: AccuracySummary, effort: Effort, tell: Callable[[str, int], None]):
        self.store, self.summary, self.effort, self.tell = store, summary, effort, tell
        self.folder = None if store.path == ":memory:" else Path(store.path).absolute().parent / "references"

    def measure(self, group: Sequence[Case]) -> None:
        self.tell(f"{group[0].label}: converged reference", 0)
        newton = cache.kept(group[0].scene, END, self.folder)
        half = cache.kept(group[0].scene, END, self.folder, inertia=HALF_ACCELERATION)
        with ExitStack() as stack:
            subjects = []
            for case in group:
                self.tell(str(case), 1)
                subject = Subject(stack.enter_context(case.open()), case)
                broken = self._judge(subject, newton, half)
                self._prepare(subject, broken)
                subjects.append(subject)
            self._sample(subjects)

    def _judge(self, subject: Subject, newton: cache.Converged, half: cache.Converged) -> Diverged | None:
        """Run to the end and store the errors; the error with which it broke, if it did."""
        case, simulation = subject.name, subject.simulation
        spacing = case.scene.grid.spacing
        estimate = newton.estimate / spacing
        numbers: dict[str, tuple[float, str, str | None]] = {}
        note = f"RMS over the free masses; the reference's own error is {estimate:.1e} spacings"
        broken = None
        try:
            simulation.advance(case.steps)
            state = simulation.state()
        except Diverged as divergence:
            broken = divergence
            numbers[ERROR] = numbers[LARGEST] = (math.inf, "spacing", str(divergence))
            numbers[UNRESOLVED] = (0.0, "", None)
        else:
            free = state.inverse_mass > 0
            error, largest = distance(state.position, newton.position, free, spacing)
            unresolved = error < RESOLVED * estimate
            numbers[ERROR] = (error, "spacing", note + ("; not resolved by it" if unresolved else ""))
            numbers[LARGEST] = (largest, "spacing", None)
            numbers[UNRESOLVED] = (float(unresolved), "", None)
            if case.scene.method.integrator == "lab":
                numbers[HALF] = (*distance(state.position, half.position, free, spacing)[:1], "spacing", "x'' = a / 2")
            energy = energies(case.scene, state.position, state.velocity)["total"]
            right = energies(case.scene, newton.position, newton.velocity)["total"]
            numbers[ENERGY], numbers[ENERGY_OFF] = (energy, "J", None), (energy - right, "J", None)
            numbers[STRAIN] = (float(np.abs(spring_strain(case.scene, state.position)).max()), "", None)
        numbers[ESTIMATE] = (estimate, "spacing", None)
        with self.store.transaction():
            for name, (value, unit, reason) in numbers.items():
                self.store.add_measure(self.summary.run, case.description, case.sources, name, value, unit, reason)
        return broken

    def _prepare(self, subject: Subject, broken: Diverged | None) -> None:
        """Choose the steps of a sample: of a run that broke those before it did, of one over its limit the run's."""
        if broken is not None:
            subject.steps = max(1, broken.step - 1)
            return
        warm_up(subject)
        if subject.simulation.scene.method.dt > subject.simulation.limit:
            subject.steps = subject.name.steps
        else:
            choose_steps(subject, self.effort.min_seconds, self.effort.max_seconds)

    def _sample(self, subjects: Sequence[Subject]) -> None:
        store, summary, repeats = self.store, self.summary, self.effort.repeats
        costs: dict[int, list[float]] = {}
        for subject, sample in interleaved(subjects, [repeats] * len(subjects), Neighbours()):
            case = subject.name
            marks = [sample.suspect, "CUDA simulator, no GPU" if case.backend == "gpu" and gpu_simulated() else None]
            suspect = "; ".join(filter(None, marks)) or None
            run, sources = summary.run, case.sources
            store.add_sample(run, case.description, sources, sample.seconds, sample.steps, stage=STAGE, suspect=suspect)
            taken = costs.setdefault(id(subject), [])
            taken.append(sample.seconds / (sample.steps * case.scene.method.dt))
            if len(taken) == repeats:  # last, so that a case with a cost is complete
                cost = statistics.median(taken)
                store.add_measure(run, case.description, sources, COST, cost, "s/s", f"median of {repeats}")
                summary.measured += 1
                self.tell(f"{case}: timed", 1)


def _points(store: Store, machine: str, everything: Sequence[Case]) -> list[AccuracyPoint]:
    """What the store holds of the cases."""
    named: dict[str, dict[str, Any]] = {}
    for measure in measures(store, machine=machine):
        named.setdefault(measure.configuration, {})[measure.name] = measure
    found = [point(c.label, c.description, named.get(configuration_hash(c.description), {})) for c in everything]
    return [entry for entry in found if entry is not None]
