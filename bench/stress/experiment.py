"""`softlab hard`: the hard cases, each by every method that it applies to, on every backend, in both precisions.

A run ends in a verdict (bench/stress/results.py) and the measured quantities with their bounds. They are stored at
once, so Ctrl-C loses none, and results of these sources are not run again. An integrator whose limit is below a scene's
step size runs at 0.9 of its limit, as noted with its verdict; where the step size is the point of the case, it is
refused. A kernel that never returns cannot be stopped from inside its process; everything else has a time limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from softlab.bench.experiments.accuracy.methods import FLUIDS, MATCHING, METHODS, TETRAHEDRAL, changes
from softlab.bench.measure.costs_timing import Measures
from softlab.bench.measure.declaration import METHODS_HELP, PRECISIONS_HELP, Choices, Experiment, Option
from softlab.bench.measure.experiment import Report, ending_cleanly, host_of, source_hash, store_measures
from softlab.bench.measure.progress import progress_bar
from softlab.bench.store.database import Store
from softlab.bench.store.results import configuration, measures_of
from softlab.bench.store.schema import Description
from softlab.bench.stress.case import HardCase
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.report import print_hard
from softlab.bench.stress.results import CHECK, CODES, SHAPE, VERDICT, HardSummary, failed, rows_of
from softlab.bench.stress.shapes import as_text, bodies_as_text
from softlab.bench.stress.tetrahedral_cases import tetrahedral_budget
from softlab.bench.stress.trial import Check, Endless, SilentNaN, Trial
from softlab.model.base.digest import source_digest
from softlab.model.base.errors import BackendUnavailable, Diverged, SceneError, SoftlabError, UnstableTimeStep
from softlab.model.core.families import stability_limit
from softlab.model.core.simulation import PRECISIONS
from softlab.model.scene.scene import Scene

SAFE = 0.9  # fraction of its limit: the step size of an integrator for which the scene's own is too large
QUICK = ("lab", "velocity-verlet", FLUIDS[0])
QUICK_PRECISIONS = ("float64",)
# methods whose end states are drawn, in addition to all failures
DRAWN = ("lab", "velocity-verlet", "xpbd gauss-seidel", MATCHING, FLUIDS[0])


@dataclass(frozen=True)
class Outcome:
    """Result of a run.

    `verdict`: one of bench.stress.results.CODES; `diagnosis`; `checks`; `end`: positions (particles, dimensions) [m] at
    `time` [s], or None.
    """

    verdict: str
    diagnosis: str
    checks: list[Check] = field(default_factory=list)
    end: np.ndarray | None = None
    time: float = 0.0


LIVE = ("gravity",)  # live, so that scenes without weight use the same kernels as the others
# files of bench/stress that determine the verdict of a case
LAWS = ("cases", "cloth", "laws", "numbers", "stiff", "trial", "xpbd")
TETRAHEDRAL_LAWS = ("tetrahedra", "tetrahedral_cases", "trial")
FLUID_LAWS = ("fluid_cases", "fluids", "trial")
BODY_LAWS = (  # these include files of bench/experiments
    "../experiments/body_laws", "../experiments/body_scenes", "../experiments/clusters_by_hand", "bodies", "body_cases",
    "piles", "rotations", "trial",
)  # fmt: skip


def case_scene(case: HardCase, method: str) -> tuple[Scene, str]:
    """Return the scene of a case under a method, and a note on its step size."""
    base = case.base()
    position_based = base.method.position_based  # the scene has its own substeps and iterations
    if case.of_tetrahedra:
        solved = tetrahedral_budget(case, method)
    elif case.of_fluids:
        solved = {"method.scheme": method.split()[-1]}
    else:
        solved = (
            {} if case.of_bodies else {"method.ordering": method.split()[-1]} if position_based else changes(method)
        )
    scene = base.replace({**solved, **case.changes})
    limit, dt = stability_limit(scene), scene.method.dt
    if not case.limited_step or dt <= limit or limit <= 0:
        return scene, ""
    reduced = float(f"{SAFE * limit:.3g}")
    return scene.replace({"method.dt": reduced}), f"at dt {reduced:g} s; {dt:g} s is over the limit of {limit:.4g} s"


def judge_case(
    case: HardCase,
    method: str,
    backend: str = "cpu",
    precision: str = "float64",
    options: Mapping[str, Any] | None = None,
) -> Outcome:
    """Run one case and return its outcome. `options`: of a Trial.

    A crash is a verdict too. Apart from Ctrl-C it only raises BackendUnavailable, for a solver that the backend does
    not have.
    """
    scene, note = case_scene(case, method)
    trial = Trial(scene, backend, precision, **({"live": LIVE} | dict(options or {})))

    def outcome(verdict: str, diagnosis: str, checks: Sequence[Check] = ()) -> Outcome:
        known = case.known_failure(method, precision)
        if verdict == "fail" and known:
            verdict, diagnosis = "known", known
        return Outcome(verdict, diagnosis, list(checks), trial.end, trial.end_time)

    try:
        checks = case.law(trial)
        refusal = _refusal(trial) if case.expect == "refused" else None
    except UnstableTimeStep as error:
        return outcome("refused", str(error))
    except SceneError as error:
        return outcome("refused" if case.expect == "refused" else "fail", str(error))
    except (Diverged, SilentNaN, Endless) as error:
        return outcome("fail", str(error))
    except BackendUnavailable:
        raise
    except Exception as error:
        return outcome("fail", f"crashed: {type(error).__name__}: {error}")
    bad = [check for check in checks if not check.good]
    if bad:
        return outcome("fail", "; ".join(map(str, bad)), checks)
    if case.expect == "refused":
        return outcome("refused", refusal, checks) if refusal else outcome("fail", "was not refused", checks)
    return outcome("pass", note, checks)


def _refusal(trial: Trial) -> str | None:
    """Return the error that opening the unchanged scene raises, or None if it opens."""
    try:
        trial.open().close()
    except SoftlabError as error:
        return str(error)
    return None


@dataclass(frozen=True)
class _Work:
    """One run to do, with the description and source hash by which the store identifies it; `drawn`: on the first backend."""

    case: HardCase
    method: str
    backend: str
    precision: str
    description: Description
    sources: str
    drawn: bool = False

    def __str__(self) -> str:
        return f"{self.case.name} {self.method} {self.precision} {self.backend}"


def _digest(case: HardCase) -> str:
    """Return a hash of the laws of the case's kind, so that a case with a changed law is run again."""
    kinds = (case.of_bodies, BODY_LAWS), (case.of_tetrahedra, TETRAHEDRAL_LAWS), (case.of_fluids, FLUID_LAWS)
    names = next((files for holds, files in kinds if holds), LAWS)
    return source_digest(*(Path(__file__).parent / f"{name}.py" for name in names))


def _work(
    cases: Sequence[HardCase], methods: Sequence[str], backends: Sequence[str], precisions: Sequence[str]
) -> list[_Work]:
    """Return all runs, those with the same machine code in succession."""
    runs, laws = [], {case.name: _digest(case) for case in cases}
    for backend, precision, method, case in product(backends, precisions, methods, cases):
        if method in case.methods:
            scene, _ = case_scene(case, method)
            description = configuration(scene, backend=backend, precision=precision, **host_of(backend))
            sources = f"{source_hash(backend)}-{laws[case.name]}"
            described = description | {"hard": case.name}
            runs.append(_Work(case, method, backend, precision, described, sources, backend == backends[0]))
    return runs


class Hard(Experiment):
    """Run the hard cases (collapsed, flipped, far away, squashed, stacked ...): each passes, fails, or is refused with a
    diagnosis."""

    # Without methods a quick run has QUICK, whose cases are then only partly run unless they are named.
    name, command = "hard cases", "hard"
    example = "softlab hard --quick   (softlab hard --case B5 --integrator rk4)"
    quick_help = (
        "Only the lab step, velocity Verlet and some fluids, in float64, no bodies: under a minute on two cores."
    )
    options: ClassVar[Mapping[str, Option]] = {
        "cases": Option(
            "--case", "Only this case, by number (B5) or name. Repeatable.", values=tuple(case.name for case in CASES),
            usual=(), rows=True,
        ),
        "integrators": Option(
            "--integrator", METHODS_HELP, values=(*METHODS, MATCHING, *TETRAHEDRAL[1:], *FLUIDS), quick=QUICK, rows=True
        ),
        "precisions": Option("--precision", PRECISIONS_HELP, values=tuple(PRECISIONS), quick=QUICK_PRECISIONS),
        "pictures": Option(
            "--pictures", "Write the final states as PNG to the folder hard beside the database.", bool, usual=(True,)
        ),
    }  # fmt: skip
    summary, report = HardSummary, staticmethod(print_hard)

    def exit_status(self, summary: HardSummary) -> int:
        """Return 2 if none of the methods runs the cases, 1 if a bug was detected."""
        return 1 if failed(summary) else 0 if summary.rows else 2

    def plan(self, store: Store, backends: Sequence[str], quick: bool, options: Choices) -> Sequence[Sequence[_Work]]:
        named = options["cases"]
        asked = [case for case in CASES if (case.name in named if named else case.quick or not quick)]
        return [[run] for run in _work(asked, options["integrators"], backends, options["precisions"])]

    def is_stored(self, store: Store, machine: str, quick: bool, case: _Work) -> bool:
        return store.has_measure(case.description, machine, case.sources, VERDICT)

    def measure(self, store: Store, summary: HardSummary, quick: bool, group: Sequence[_Work], report: Report) -> None:
        for work in group:
            report(str(work), 0)
            _judge(store, summary, work)
            report(str(work), 1)

    def finish(
        self, store: Store, summary: HardSummary, cases: Sequence[_Work], options: Choices, progress: bool
    ) -> None:
        with ending_cleanly(summary):
            if options["pictures"] and store.path != ":memory:" and not summary.interrupted:
                _draw(summary, Path(store.path).absolute().parent / "hard", progress)
        summary.rows = rows_of(measures_of(store, summary.machine, (one.description for one in cases)))


run_hard = Hard()


def _judge(store: Store, summary: HardSummary, work: _Work) -> None:
    """Run one case, store its checks, shape and verdict, all or none, and append end states to draw to the summary's.

    Nothing is stored for a solver that the backend does not have.
    """
    try:
        outcome = judge_case(work.case, work.method, work.backend, work.precision)
    except BackendUnavailable:
        return
    drawn = outcome.end is not None and (
        outcome.verdict in ("fail", "known") or (work.drawn and work.precision == "float64" and work.method in DRAWN)
    )
    numbers: Measures = {
        f"{CHECK}{place:02d} {check.name}": (
            None if np.isnan(check.value) else check.value,
            check.unit,
            check.bound_text,
        )
        for place, check in enumerate(outcome.checks)
    }
    if drawn:
        assert outcome.end is not None
        scene, _ = case_scene(work.case, work.method)
        numbers[SHAPE] = None, "m", _shape(scene, outcome.end)
        summary.ends.append((work, outcome))
    numbers[VERDICT] = CODES[outcome.verdict], "", outcome.diagnosis
    store_measures(store, summary.run, work.description, work.sources, numbers)
    summary.measured += 1


def _shape(scene: Scene, end: np.ndarray) -> str:
    if scene.content == "sheet":
        return as_text(end, scene.grid.rows, scene.grid.columns)
    return bodies_as_text(end, scene.body_set.body if scene.copies else np.zeros(len(end), int))


def _draw(summary: HardSummary, folder: Path, show: bool) -> None:
    """Draw a picture of every stored end state; without OpenGL, set `summary.no_pictures` to the reason."""
    from softlab.app.output.offscreen import Picture, opengl_available, render_frame

    if not summary.ends:
        return
    works, reason = opengl_available()
    if not works:
        summary.no_pictures = reason
        return
    folder.mkdir(exist_ok=True)
    with progress_bar(show) as bar:
        for work, outcome in bar.track(summary.ends, description="pictures"):
            scene, _ = case_scene(work.case, work.method)
            words = [work.case.name.replace(" ", "-"), work.method, work.precision, work.backend]
            caption = f"{work.case.name}: {work.case.title}, {work.method}: {outcome.verdict}"
            target = folder / f"{'-'.join(words)}.png"
            assert outcome.end is not None  # only runs with an end state are drawn
            render_frame(scene, outcome.end, target, Picture(640, 480, caption), time=outcome.time)
            summary.pictures += 1
