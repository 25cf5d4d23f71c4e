"""Speed against error: every integrator, step size, precision and backend on scenes with a converged reference.

Scenes S1 (`lab-curtain`) and S2 (`lab-hammock`) run to 1.5 s, a time at which a perturbation has not yet grown (the
damped net contracts), so that the distance to the reference means something. Reference: RK4 at h and h/2 with
Richardson extrapolation in NumPy float64 (bench/reference/), with its own error estimate; a point under ten times that
is marked as not resolved. A twin of it, disturbed by 1e-9, gives the growth factor that stands beside every error;
beyond 1e3 the error is refused (bench/growth.py). Runs that diverge are points with an infinite error and a reason:
where a method breaks is a result.

Scene S4 (`cloth-wind`), a cloth in wind, runs to 1.0 s at step sizes of its own, but not if quick: its reference, though
less sharp than the grids' (CLOTH_TOLERANCE), takes most of a minute.

The hand-out's step is held against Newton's law like all others, and on grids beside it against x'' = a / 2, which it
solves.

Error and time of one configuration are had from the same opened simulation; times as bench/timing.py says. Practice:
Hairer and Wanner, "Solving ODEs II", IV.10; SciML's work-precision diagrams.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.driver import open_simulation
from bench.accuracy_points import (
    CLOTHS,
    COPY,
    COST,
    END,
    SCENES,
    SIZES,
    AccuracyPoint,
    AccuracySummary,
    end_of,
    pareto_front,
    point,
)
from bench.choice import chosen
from bench.growth import Growth, kept_growth
from bench.judge import distance
from bench.judgement import ERROR, GROWTH, HALF, RESOLVED, UNRESOLVED, judge
from bench.machine import enter_machine, gpu_simulated, source_revision
from bench.progress import progress_bar
from bench.reference import cache
from bench.results import configuration, measures
from bench.store import Store, configuration_hash
from bench.sweep import backends_here, source_hash
from bench.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from cpu_backend.threads import thread_count, threading_layer, wait_policy
from model.digest import source_digest
from model.errors import Diverged
from model.integrators import INTEGRATORS
from model.scene import Scene, load_scene
from model.simulation import PRECISIONS, Simulation

__all__ = [
    "COST",
    "END",
    "ERROR",
    "HALF",
    "RESOLVED",
    "SCENES",
    "STAGE",
    "STEP_SIZES",
    "UNRESOLVED",
    "AccuracyPoint",
    "AccuracySummary",
    "distance",
    "pareto_front",
    "run_accuracy",
]

STEP_SIZES = (0.02, 0.01, 0.005, 0.0025)  # s
CLOTH_STEP_SIZES = (0.004, 0.002, 0.001, 0.0005)  # s
CLOTH_TOLERANCE = 2e-7  # spacings; RK4 at dt 0.0005 on S4 is at 3e-6, and shall be resolved tenfold
HALF_ACCELERATION = 2.0  # inertia of the equation that the hand-out's step converges to
WIDE = ("semi-implicit-euler", "velocity-verlet", "rk4")  # of exact math and other sizes: what holds at these steps
COPIES = 3  # of the state to the host, of which the median counts
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
    math: str
    description: dict[str, Any]
    sources: str

    @property
    def steps(self) -> int:
        return round(end_of(self.label) / self.scene.method.dt)

    def __str__(self) -> str:
        method = self.scene.method
        return f"{self.label} {method.integrator} dt {method.dt:g} {self.precision} {self.math} {self.backend}"

    def open(self) -> Simulation:
        return open_simulation(self.scene, self.backend, precision=self.precision, math=self.math, allow_unstable=True)


def cases(
    scenes: Sequence[str],
    backends: Sequence[str],
    wide: bool = False,
    integrators: Sequence[str] | None = None,
    precisions: Sequence[str] | None = None,
) -> list[Case]:
    """Each scene x backend x precision x integrator x step size, in the order they are measured (None: all).

    `wide`: also `exact` math, and other sizes (SIZES), of S1 and the integrators WIDE.
    """
    found = []
    names = integrators or tuple(INTEGRATORS)
    few = tuple(name for name in WIDE if integrators is None or name in integrators)
    for label in scenes:
        base = load_scene((SCENES | CLOTHS)[label])
        kinds: list[tuple[str, Scene, Sequence[str], str]] = [(label, base, names, "fast")]
        if wide and label == "S1":
            kinds.append((label, base, few, "exact"))
            for name, (_, n) in SIZES.items():
                kinds.append((name, base.replace({"grid.rows": n, "grid.columns": n}), few, "fast"))
        found += [
            make_case(name, sized.replace({"method.integrator": integrator, "method.dt": dt}), backend, precision, math)
            for name, sized, used, math in kinds
            for backend in backends
            for precision in precisions or PRECISIONS
            for integrator in used
            for dt in (CLOTH_STEP_SIZES if label in CLOTHS else STEP_SIZES)
        ]
    return found


def make_case(label: str, scene: Scene, backend: str, precision: str, math: str = "fast") -> Case:
    """One configuration, described as the store holds it."""
    host: dict[str, Any] = {}
    if backend == "cpu":
        host = {"threads": thread_count("1x"), "layer": threading_layer(), "wait_policy": wait_policy()}
    description = configuration(scene, backend=backend, precision=precision, math=math, **host)
    return Case(label, scene, backend, precision, math, description, judged_sources(backend))


def judged_sources(backend: str) -> str:
    """The hash of what an error depends on: the backend's sources, and the reference's."""
    return f"{source_hash(backend)}-{source_digest(Path(cache.__file__).parent)}"


def run_accuracy(
    store: Store,
    *,
    quick: bool = False,
    integrators: Sequence[str] | None = None,
    precisions: Sequence[str] | None = None,
    backends: Sequence[str] | None = None,
    scenes: Sequence[str] | None = None,
    progress: bool = True,
    command: str = "softlab accuracy",
) -> AccuracySummary:
    """Judge what the store lacks of the grid of cases, and return all of its points.

    `quick`: fewer and shorter samples, and neither `exact` math nor other sizes. `scenes`: labels of SCENES and CLOTHS (None:
    all; no cloth if `quick`). `integrators`, `precisions`: None: all; parts that are run apart meet in the store. `backends`:
    cpu, gpu (None: all that are here). References are kept in the folder `references` beside the store. Every number is on
    disk when it is had; Ctrl-C ends cleanly.

    Raises SceneError (an unknown name), BackendUnavailable (one asked for that is not here), InputError (the store).
    """
    begin = time.perf_counter()
    effort = QUICK if quick else FULL
    names = chosen(integrators, list(INTEGRATORS), "--integrator")
    accurate = chosen(precisions, list(PRECISIONS), "--precision")
    here, revision = backends_here(backends), source_revision()
    summary = AccuracySummary(enter_machine(store))
    labels = scenes or (*SCENES, *([] if quick else CLOTHS))
    everything = cases(labels, here, not quick, names, accurate)
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
    key = case.description, machine, case.sources
    told = all(store.has_measure(*key, name) for name in (COST, GROWTH))
    return told and store.sample_count(*key, STAGE) >= effort.repeats


def _measure_all(store: Store, summary: AccuracySummary, missing: list[Case], effort: Effort, show: bool) -> None:
    with progress_bar(show) as bar:
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
        self.folder = references(store)

    def measure(self, group: Sequence[Case]) -> None:
        scene, end = group[0].scene, end_of(group[0].label)
        self.tell(f"{group[0].label}: converged reference", 0)
        if scene.cloth:
            newton, half = cache.kept(scene, end, self.folder, tolerance=CLOTH_TOLERANCE), None
        else:
            newton = cache.kept(scene, end, self.folder)
            half = cache.kept(scene, end, self.folder, inertia=HALF_ACCELERATION)
        growth = kept_growth(scene, end, self.folder)
        with ExitStack() as stack:
            subjects = []
            for case in group:
                self.tell(str(case), 1)
                subject = Subject(stack.enter_context(case.open()), case)
                broken = self._judge(subject, newton, half, growth)
                self._prepare(subject, broken)
                subjects.append(subject)
            self._sample(subjects)

    def _judge(
        self, subject: Subject, newton: cache.Converged, half: cache.Converged | None, growth: Growth
    ) -> Diverged | None:
        """Run to the end and store the errors; the error with which it broke, if it did."""
        case, simulation = subject.name, subject.simulation
        broken, copying = None, None
        try:
            simulation.advance(case.steps)
            state = simulation.state()
        except Diverged as divergence:
            broken = divergence
        else:
            copying = copy_seconds(simulation)
        numbers = judge(case.scene, broken or state, newton, growth, half)
        if copying is not None:
            numbers[COPY] = (copying, "s", f"median of {COPIES}, the whole state")
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


def references(store: Store) -> Path | None:
    """The folder of the converged references that belong to a store; None for one in memory."""
    return None if store.path == ":memory:" else Path(store.path).absolute().parent / "references"


def copy_seconds(simulation: Simulation) -> float:
    """Seconds that the state takes from the device to arrays on the host; the state must be checked already."""
    taken = []
    for _ in range(COPIES):
        begin = time.perf_counter()
        simulation.state()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken)


def _points(store: Store, machine: str, everything: Sequence[Case]) -> list[AccuracyPoint]:
    """What the store holds of the cases."""
    named: dict[str, dict[str, Any]] = {}
    for measure in measures(store, machine=machine):
        named.setdefault(measure.configuration, {})[measure.name] = measure
    found = [point(c.label, c.description, named.get(configuration_hash(c.description), {})) for c in everything]
    return [entry for entry in found if entry is not None]
