"""`softlab ablate`: drop one part of a scene or make one setting cheaper at a time, and measure both sides.

The error of every run is that against the full scene's converged reference, reported with the growth of a disturbance
(bench/experiments/growth.py). The verdict depends on the change, the distance to the full scene's own run at the same time:
if it is less than the full scene's own error, the effect of the part cannot be distinguished from the method's error,
and the part is not needed at this step size. If the motion is chaotic by then there is no verdict, and statistics are
shown instead.

All runs of a backend are timed in turn with the full scene (A B A B ...), each from the scene's start. The minimum of
the repeats counts, since disturbances only make a sample longer. Every result is stored as soon as it is measured.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from softlab.bench.experiments.accuracy.cases import Case, make_case
from softlab.bench.experiments.accuracy.judge import distance
from softlab.bench.experiments.accuracy.judgement import judge
from softlab.bench.experiments.accuracy.methods import newton, sweeps
from softlab.bench.experiments.accuracy.points import END
from softlab.bench.experiments.accuracy.references import (
    LAB_SECONDS,
    by_numpy,
    converged_of,
    growth_of,
    lab_converged,
    lab_seconds,
    numpy_seconds,
    references,
    stepped_force_converged,
    stepped_force_seconds,
)
from softlab.bench.experiments.advise.ablation import FULL, Ablation, ablations, random_force
from softlab.bench.experiments.advise.ablation_results import (
    CHANGE,
    PREFIX,
    SECONDS,
    SUSPECT,
    AblationSummary,
    tables_of,
)
from softlab.bench.experiments.advise.experiment import REFERENCE_SECONDS
from softlab.bench.experiments.growth import Growth
from softlab.bench.measure.experiment import Report, backends_here, resume, store_measures
from softlab.bench.measure.samples import in_turns
from softlab.bench.measure.timing import Subject, prepare_runs
from softlab.bench.reference import cache
from softlab.bench.reference.cache import Converged
from softlab.bench.store.database import Store
from softlab.bench.store.results import measures_of
from softlab.bench.store.schema import configuration_hash
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core.build import pinned_indices
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

VERSION = 1  # part of every resume key: raise it when the measurement changes
STAGE = "ablate"  # stage of the samples in the store
REPEATS, SAMPLE_SECONDS = 9, 0.03
MAX_ROUNDS, DISTURBED = 3, 1.5  # rounds of samples, repeated while a median is above this multiple of the minimum
FOR_STATISTICS = 1e-3  # spacings: for a chaotic motion, whose reference would take minutes to be more accurate
RUN_SECONDS = 60.0  # longest estimated time of one run up to the time of judgement


@dataclass(frozen=True)
class Variant:
    """One run of `steps` steps: its `ablation`, and the `case` by which the store identifies it."""

    ablation: Ablation
    case: Case
    steps: int


def ablate(
    store: Store,
    scene: Scene,
    *,
    backends: Sequence[str] | None = None,
    time: float | None = None,
    progress: bool = True,
    command: str = "softlab ablate",
) -> AblationSummary:
    """Measure the effect of each part of the scene, its arithmetic, integrator and step size at `time` [s] (None: 1.5).

    `backends`: None for all that are available. Only what the store lacks is measured; Ctrl-C ends the run cleanly.

    Raises SceneError (an impossible time, a step size above the limit, no moving mass, a reference or run that would
    take too long, constraints without a force law), BackendUnavailable, InputError (the store), Diverged (the full
    scene).
    """
    wanted = END if time is None else time
    steps, chosen = _check(scene, wanted), backends_here(backends)
    summary = AblationSummary.begun(store, "ablate")
    work = _Work(store, scene, steps, summary)
    groups = [work.variants(backend) for backend in chosen]

    def is_stored(variant: Variant) -> bool:
        return store.has_measure(variant.case.description, summary.machine, variant.case.sources, SECONDS)

    def measure(group: Sequence[Variant], report: Report) -> None:
        work.measure(group, report)

    resume(
        store, summary, groups, is_stored, measure, progress=progress, command=command, worth=lambda variant: 2,
        whole=True,  # times are comparable only if sampled in turn
    )  # fmt: skip
    descriptions = [variant.case.description for group in groups for variant in group]
    summary.tables = tables_of(measures_of(store, summary.machine, descriptions))
    summary.notes += _notes(scene, wanted, work.end, summary)
    summary.stop()
    return summary


def _check(scene: Scene, end: float) -> int:
    """Return the number of steps up to `end` [s], an even number; refuse scenes without an answer before measuring."""
    dt = scene.method.dt
    if not 0 < end < math.inf:
        raise SceneError("--time", end, "must be greater than 0 and finite")
    motion = newton(scene)
    if len(set(pinned_indices(scene.grid).tolist())) == scene.grid.particle_count:
        raise SceneError("grid.pinned", scene.grid.pinned, "every mass is pinned, so nothing moves")
    limit = stability_limit(scene)
    if dt > limit * (1 + 1e-12):
        remedy = (
            f"pass --set method.dt={0.9 * limit:.2g}" if limit else "choose another with --set method.integrator=..."
        )
        raise SceneError("method.dt", dt, f"over the stability limit {limit:.6g} s of {scene.method.name}; {remedy}")
    steps = 2 * round(end / (2 * dt))
    if steps < 2:
        raise SceneError("--time", end, f"must be at least two steps of method.dt, {2 * dt:g} s")
    method = scene.method
    forces = sweeps(method.name, method.iterations, method.substeps)
    seconds = 2 * steps * forces * (scene.grid.particle_count * LAB_SECONDS + 1e-6)
    if random_force(scene):
        judged = stepped_force_seconds(motion, steps) + numpy_seconds(motion, end)
    else:
        judged = min(numpy_seconds(motion, end), lab_seconds(motion, end))
    for what, needed, most in (("a run", seconds, RUN_SECONDS), ("its reference", judged, REFERENCE_SECONDS)):
        if needed > most:
            fits = end * most / needed
            raise SceneError("--time", end, f"{what} would take about {needed:.0f} s; use at most {fits:.1g}, or a "
                             "smaller grid")  # fmt: skip
    return steps


def _notes(scene: Scene, wanted: float, end: float, summary: AblationSummary) -> list[str]:
    notes = []
    if not math.isclose(wanted, end, rel_tol=1e-9):
        notes.append(f"judged at {end:g} s, not {wanted:g}: a whole number of steps and of steps of twice the size")
    if random_force(scene):
        notes.append(
            "the random force differs at every step size: step sizes are not varied, and the reference keeps each "
            "random value over its step"
        )
    elif not by_numpy(scene, end):
        notes.append("the reference was solved by the lab's own rk4 in float64: NumPy's would have taken minutes")
    if any(row.suspect for table in summary.tables for row in (table.full, *table.rows)):
        notes.append("?: other programs ran, or the samples scatter; repeat it on a quiet machine")
    return notes


class _Work:
    """Measurement of one scene; `end` [s]: the time at which errors are computed."""

    def __init__(self, store: Store, scene: Scene, steps: int, summary: AblationSummary):
        self.store, self.scene, self.steps, self.summary = store, scene, steps, summary
        self.end = steps * scene.method.dt
        self._full: State

    def variants(self, backend: str) -> list[Variant]:
        """Return the full scene and everything that can be left out of it."""
        key = ""
        all_variants = []
        for ablation in (FULL, *ablations(self.scene)):
            scene = ablation.of(self.scene)
            case = make_case("", scene, backend, ablation.precision, ablation.math)
            key = key or configuration_hash(case.description | {"end": self.end})
            entry = {"full": key, "title": self.scene.title, "name": ablation.name, "kind": ablation.kind,
                    "spares": ablation.spares}  # fmt: skip
            described = case.description | {"end": self.end, "ablation": entry}
            case = replace(case, description=described, sources=f"{case.sources}-a{VERSION}")
            all_variants.append(Variant(ablation, case, round(self.end / scene.method.dt)))
        return all_variants

    @cached_property
    def right(self) -> tuple[Converged, Growth]:
        """Reference, and growth of a disturbance."""
        folder, motion = references(self.store), newton(self.scene)
        growth = growth_of(motion, self.end, folder)
        if random_force(motion):
            return stepped_force_converged(motion, self.steps, folder), growth
        if not growth.chaotic:
            return converged_of(motion, self.end, folder), growth
        if by_numpy(motion, self.end):
            return cache.cached_reference(motion, self.end, folder, tolerance=FOR_STATISTICS), growth
        return lab_converged(motion, self.end, FOR_STATISTICS), growth

    def measure(self, group: Sequence[Variant], report: Report) -> None:
        """Compute the errors of a group, then sample those that did not diverge in turn. Raises Diverged if the full
        scene does.
        """
        report("converged reference", 0)
        right = self.right
        with ExitStack() as stack:
            subjects = []
            for variant in group:
                report(f"{variant.ablation.name}, {variant.case.backend}", 1)
                subject = Subject(stack.enter_context(variant.case.open()), variant)
                if self._judge(subject, right):
                    subjects.append(prepare_runs(subject, variant.steps, SAMPLE_SECONDS))
                else:
                    self._add(variant, {SECONDS: (None, "s/s", "diverged")})
                    report(f"{variant.ablation.name} diverged", 1)
            self._time(subjects, report)
        self.summary.measured += len(group)

    def _add(self, variant: Variant, numbers: Mapping[str, tuple[float | None, str, str | None]]) -> None:
        store_measures(self.store, self.summary.run, variant.case.description, variant.case.sources, numbers)

    def _judge(self, subject: Subject, right: tuple[Converged, Growth]) -> bool:
        """Run to the end and store errors and change; return False if the run diverged."""
        variant, simulation = subject.name, subject.simulation
        outcome: State | Diverged
        try:
            simulation.advance(variant.steps)
            outcome = simulation.state()
        except Diverged as diverged:
            if variant.ablation is FULL:
                raise
            outcome = diverged
        if variant.ablation is FULL:
            assert isinstance(outcome, State)
            self._full = outcome
        judged = judge(self.scene, outcome, *right)  # uses the energy of the full scene
        numbers: dict[str, tuple[Any, str, str | None]] = {
            PREFIX + name.removeprefix("accuracy_"): value for name, value in judged.items()
        }
        if isinstance(outcome, Diverged):
            numbers[CHANGE] = (math.inf, "spacing", str(outcome))
        else:
            numbers[CHANGE] = (self._change(outcome), "spacing", variant.ablation.why)
        self._add(variant, numbers)
        return isinstance(outcome, State)

    def _change(self, state: State) -> float:
        free = state.inverse_mass > 0
        theirs = self._full.position.astype(np.float64)
        return distance(state.position, theirs, free, self.scene.grid.spacing)[0]

    def _time(self, subjects: Sequence[Subject], report: Report) -> None:
        """Sample in turn, repeat disturbed samples, and store the minimum of each."""
        taken: dict[int, list[float]] = {id(subject): [] for subject in subjects}
        marks: dict[int, list[str]] = {id(subject): [] for subject in subjects}
        for _ in range(MAX_ROUNDS):
            sampled = in_turns(self.store, self.summary.run, STAGE, subjects, REPEATS, lambda variant: variant.case)
            for subject, samples in sampled:
                dt = subject.name.case.scene.method.dt
                taken[id(subject)] += [sample.seconds / (sample.steps * dt) for sample in samples]
                marks[id(subject)] += [sample.suspect for sample in samples if sample.suspect]
            if all(statistics.median(times) <= DISTURBED * min(times) for times in taken.values()):
                break
        for subject in subjects:
            times, reasons = taken[id(subject)], list(dict.fromkeys(marks[id(subject)]))
            spread = statistics.median(times) / min(times)
            reasons += [f"the median is {spread:.2g} times the least"] if spread > DISTURBED else []
            cost = (min(times), "s/s", f"least of {len(times)}")
            self._add(subject.name, {SUSPECT: (float(bool(reasons)), "", "; ".join(reasons) or None), SECONDS: cost})
            report(f"{subject.name.ablation.name}: timed", 1)
