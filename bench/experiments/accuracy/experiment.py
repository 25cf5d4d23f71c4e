"""Speed against error: every method, step size, precision and backend on scenes with a converged reference.

S1 (`lab-curtain`) and S2 (`lab-hammock`) run to 1.5 s. The damped net contracts, so no perturbation has grown by then
and the distance to the reference is meaningful. The reference is RK4 at h and h/2 with Richardson extrapolation in
NumPy float64 (bench/reference/), with an estimate of its own error; a point whose error is less than ten times that
estimate is marked as not resolved. A second reference run, disturbed by 1e-9, gives the growth factor that is reported
beside every error; above 1e3 the error is refused (bench/experiments/growth.py). Runs that diverge are points with an
infinite error and a reason, because where a method breaks is a result.

S4 (`cloth-wind`), a cloth in wind, runs to 1.0 s, and S5 (`cloth-drop`), a cloth that falls on a ball, to 0.5 s; both
have step sizes of their own and run with implicit Euler too. S6 (`rope-stiff`) is a stiff rope with a heavy end that
swings down to 1.0 s. In S6-still (`rope-stiff-still`) it hangs at rest by 12 s, where a closed form gives its
elongation; only position-based solvers support loads. A quick run has none of these scenes, because their references
take up to a minute (bench/experiments/accuracy/references.py).

The hand-out's step is compared with Newton's law like all other methods, and on grids with x'' = a / 2 as well, the
equation that it solves. Position-based solvers are run with several numbers of iterations. They have a second error, to
their own scheme with converged iterations, and the residuals of a step (bench/experiments/accuracy/solver_error.py).

Error and time of a configuration come from the same opened simulation and from the same interval: a sample is whole runs
from the start to the time at which the error is judged, with their launches, rewound outside the clock
(bench/measure/timing.py). Samples of the stage `OLDER_STAGE` are of another interval.
Practice: Hairer and Wanner, "Solving ODEs II", IV.10; work-precision diagrams of SciML.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from softlab.bench.experiments.accuracy.cases import Case, cases
from softlab.bench.experiments.accuracy.judgement import GROWTH, SOLVER, judge
from softlab.bench.experiments.accuracy.methods import METHODS, OF_CLOTHS
from softlab.bench.experiments.accuracy.points import (
    AT_REST,
    CLOTHS,
    COPY,
    COST,
    SCENES,
    AccuracyPoint,
    AccuracySummary,
    end_of,
    labels_of,
    point,
)
from softlab.bench.experiments.accuracy.references import motion_of, references, references_for
from softlab.bench.experiments.accuracy.solver_error import Iterated, iterate, solver_numbers
from softlab.bench.experiments.growth import Growth
from softlab.bench.measure.compile_ahead import Job
from softlab.bench.measure.declaration import METHODS_HELP, PRECISIONS_HELP, Choices, Experiment, Option
from softlab.bench.measure.experiment import Report, source_hash, store_measures
from softlab.bench.measure.samples import in_turns
from softlab.bench.measure.timing import Subject, prepare_runs
from softlab.bench.reference import cache
from softlab.bench.store.database import Store
from softlab.bench.store.results import by_configuration, measures_of, timings
from softlab.bench.store.schema import configuration_hash
from softlab.model.base.errors import Diverged
from softlab.model.core.simulation import PRECISIONS, Simulation
from softlab.model.scene.scene import Scene

COPIES = 3  # copies of the state to the host; their median is stored
STAGE = "accuracy runs"  # stage of the samples in the store, different from the sweep's
OLDER_STAGE = "accuracy"  # samples of runs that went on far beyond the time of the error
QUICK_EFFORT, EFFORT = (3, 0.01), (7, 0.02)  # samples, and how long one takes at least [s]


class Accuracy(Experiment):
    """Measure error and speed of every method, step size and precision of grids and cloth (bodies: softlab bar)."""

    # The summary has all points of the grid of cases. A quick run has fewer and shorter samples, no `exact` math, no other
    # sizes, one ordering of xpbd, few iterations, no cloths unless they are named. Subsets that are run separately are
    # combined in the store. References are stored in the folder `references` beside the store.
    name = command = "accuracy"
    example = "softlab accuracy --quick   (softlab accuracy --integrator rk4 --precision float64)"
    quick_help = "Fewer repeats and methods, less float32, no exact math, one size."
    on_workers = True
    options = {  # without these: fewer than all, see `cases`
        "integrators": Option("--integrator", METHODS_HELP, values=(*METHODS, *OF_CLOTHS), usual=(), rows=True),
        "precisions": Option("--precision", PRECISIONS_HELP, values=tuple(PRECISIONS), usual=()),
        "scenes": Option(
            "--scene", "Only S1 (lab-curtain), S2, S4, S5, S6 or S6-still. Repeatable.", values=(*SCENES, *CLOTHS),
            quick=tuple(SCENES), words="SCENE",
        ),
    }  # fmt: skip
    summary = AccuracySummary

    def picked(self, how: Choices, quick: bool) -> Choices:
        return super().picked({**how, "scenes": labels_of(how.get("scenes") or ())}, quick)

    def plan(self, store: Store, backends: Sequence[str], quick: bool, options: Choices) -> Sequence[Sequence[Case]]:
        """Return the cases of each scene and backend."""
        groups: dict[tuple[str, str], list[Case]] = {}
        methods, precisions = options["integrators"] or None, options["precisions"] or None
        for case in cases(options["scenes"], backends, not quick, methods, precisions):
            groups.setdefault((case.label, case.backend), []).append(case)
        return list(groups.values())

    def is_stored(self, store: Store, machine: str, quick: bool, case: Case) -> bool:
        key = case.description, machine, case.sources
        wanted = (COST, GROWTH, SOLVER) if case.scene.method.position_based else (COST, GROWTH)
        has_measures = all(store.has_measure(*key, name) for name in wanted)
        return has_measures and store.sample_count(*key, STAGE) >= (QUICK_EFFORT if quick else EFFORT)[0]

    def measure(
        self, store: Store, summary: AccuracySummary, quick: bool, group: Sequence[Case], report: Report
    ) -> None:
        _Group(store, summary, *(QUICK_EFFORT if quick else EFFORT), report).measure(group)

    def before(self, store: Store, cases: Sequence[Case]) -> list[Job]:
        return _reference_jobs(cases, references(store))

    def finish(
        self, store: Store, summary: AccuracySummary, cases: Sequence[Case], options: Choices, progress: bool
    ) -> None:
        summary.points = _points(store, summary.machine, cases)


run_accuracy = Accuracy()


def _reference_jobs(missing: Sequence[Case], folder: Path | None) -> list[Job]:
    """Return the jobs that store the references of these cases in `folder` (None: none can)."""
    if folder is None:
        return []
    jobs: list[Job] = []
    iterated: dict[tuple[str, ...], dict[int, tuple[Scene, int]]] = {}
    for case in missing:
        scene, end = motion_of(case.scene), end_of(case.label)
        key = str(folder), case.label, cache.key(scene, end, 1.0, cache.TOLERANCE), source_hash("cpu")
        jobs.append(Job(("references", *key), partial(references_for, case.label, scene, end, folder)))
        method = case.scene.method
        if method.position_based and case.label not in AT_REST:
            odd = method.iterations // (method.iterations & -method.iterations)  # doubling keeps the odd factor
            same = iterated.setdefault((*key, method.name, f"{method.dt:g}", str(odd)), {})
            same[method.iterations] = (case.scene, case.steps)
    for names, same in iterated.items():
        kind = ("iterated", *names, *(str(iterations) for iterations in sorted(same)))
        jobs.append(Job(kind, partial(iterate, tuple(same.values()), folder)))
    return jobs


class _Group:
    """Cases of one scene and backend: their errors are computed one after another, then their times are sampled in
    turn.
    """

    def __init__(self, store: Store, summary: AccuracySummary, repeats: int, seconds: float, report: Report):
        self.store, self.summary, self.report = store, summary, report
        self.repeats, self.seconds = repeats, seconds
        self.folder = references(store)
        self.iterated = Iterated(self.folder)

    def measure(self, group: Sequence[Case]) -> None:
        label = group[0].label
        scene, end = motion_of(group[0].scene), end_of(label)
        self.report(f"{label}: converged reference", 0)
        right, half, growth = references_for(label, scene, end, self.folder)
        with ExitStack() as stack:
            subjects = []
            for case in group:
                self.report(str(case), 1)
                subject = Subject(stack.enter_context(case.open()), case)
                broken = self._judge(subject, right, half, growth)
                if broken is None:
                    prepare_runs(subject, case.steps, self.seconds)
                else:
                    subject.steps = max(1, broken.step - 1)  # the steps before the one that diverged
                subjects.append(subject)
            self._sample(subjects)

    def _judge(
        self, subject: Subject, right: cache.Converged, half: cache.Converged | None, growth: Growth
    ) -> Diverged | None:
        """Run the case to its end and store the errors; return the divergence, or None if the run stayed finite."""
        case, simulation = subject.name, subject.simulation
        broken, copying = None, None
        try:
            simulation.advance(case.steps)
            state = simulation.state()
        except Diverged as divergence:
            broken = divergence
        else:
            copying = copy_seconds(simulation)
        numbers = judge(case.scene, broken or state, right, growth, half)
        if case.scene.method.position_based:
            if broken is None:
                rest = right.position if case.label in AT_REST else None
                numbers |= solver_numbers(case.scene, state, case.steps, self.iterated, rest)
            else:
                numbers[SOLVER] = (math.inf, "spacing", str(broken))
        if copying is not None:
            numbers[COPY] = (copying, "s", f"median of {COPIES}, the whole state")
        store_measures(self.store, self.summary.run, case.description, case.sources, numbers)
        return broken

    def _sample(self, subjects: Sequence[Subject]) -> None:
        store, summary, repeats = self.store, self.summary, self.repeats
        for subject, samples in in_turns(store, summary.run, STAGE, subjects, repeats):
            case = subject.name
            median = statistics.median(sample.seconds / (sample.steps * case.scene.method.dt) for sample in samples)
            cost = median, "s/s", f"median of {repeats}"  # stored last, so that a case with a cost is complete
            store_measures(store, summary.run, case.description, case.sources, {COST: cost})
            summary.measured += 1
            self.report(f"{case}: timed", 1)


def copy_seconds(simulation: Simulation) -> float:
    """Time [s] that the state takes from the device to arrays on the host; the state must have been checked before."""
    taken = []
    for _ in range(COPIES):
        begin = time.perf_counter()
        simulation.state()
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken)


def _points(store: Store, machine: str, everything: Sequence[Case]) -> list[AccuracyPoint]:
    """Return the points of the cases that the store has results of, in the order of the cases."""
    stored = by_configuration(measures_of(store, machine, (case.description for case in everything)))
    named = {next(iter(one.values())).configuration: one for one in stored}
    repeats = {timing.configuration: timing for timing in timings(store, machine, STAGE)}
    keys = [configuration_hash(case.description) for case in everything]
    points = [
        point(case.label, case.description, named.get(key, {}), repeats.get(key))
        for case, key in zip(everything, keys, strict=True)
    ]
    return [entry for entry in points if entry is not None]
