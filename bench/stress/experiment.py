"""Where it breaks: the hard cases, each under every method that it is for, on every backend, in both precisions.

A run ends in a verdict (bench/stress/results.py) and the measured quantities beside their bounds, which go into the store as
soon as they are had: Ctrl-C loses none, and what is held of these sources is not run again. An integrator whose limit is
below a scene's step size runs at 0.9 of its limit, which is said beside its verdict; where the step size is the point of
the case, it is refused.

A kernel that never returns cannot be stopped from inside its process; everything else is looked at by the clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.experiments.accuracy.methods import FLUIDS, MATCHING, METHODS, TETRAHEDRAL, changes
from bench.measure.costs_timing import Measures
from bench.measure.experiment import Tell, backends_here, chosen, ending_cleanly, host_of, keep, resume, source_hash
from bench.measure.progress import progress_bar
from bench.store.database import Store
from bench.store.results import configuration, measures_of
from bench.stress.case import HardCase
from bench.stress.cases import CASES
from bench.stress.results import CHECK, CODES, SHAPE, VERDICT, HardSummary, rows_of
from bench.stress.shapes import as_text, bodies_as_text
from bench.stress.tetrahedral_cases import tetrahedral_budget
from bench.stress.trial import Check, Endless, SilentNaN, Trial
from model.core.digest import source_digest
from model.core.errors import BackendUnavailable, Diverged, SceneError, SoftlabError, UnstableTimeStep
from model.core.families import stability_limit
from model.core.simulation import PRECISIONS
from model.scene.scene import Scene

SAFE = 0.9  # of its limit: the step size of an integrator that the scene's own is too large for
QUICK = ("lab", "velocity-verlet", FLUIDS[0])
QUICK_PRECISIONS = ("float64",)
# methods whose end states are drawn, besides all that failed
DRAWN = ("lab", "velocity-verlet", "xpbd gauss-seidel", MATCHING, FLUIDS[0])


@dataclass(frozen=True)
class Outcome:
    """`verdict`: of bench.stress.results.CODES; `diagnosis`; `checks`; `end`: positions (particles, dimensions) [m] or None,
    at `time` [s]."""

    verdict: str
    diagnosis: str
    checks: list[Check] = field(default_factory=list)
    end: np.ndarray | None = None
    time: float = 0.0


LIVE = ("gravity",)  # so that scenes without weight share kernels with the others
# files of bench/stress by which a case is judged
LAWS = ("cases", "cloth", "laws", "numbers", "stiff", "trial", "xpbd")
TETRAHEDRAL_LAWS = ("tetrahedra", "tetrahedral_cases", "trial")
FLUID_LAWS = ("fluid_cases", "fluids", "trial")
BODY_LAWS = (  # and of bench/experiments, one of bodies
    "../experiments/body_laws", "../experiments/body_scenes", "../experiments/clusters_by_hand", "bodies", "body_cases",
    "piles", "rotations", "trial",
)  # fmt: skip


def case_scene(case: HardCase, method: str) -> tuple[Scene, str]:
    """The scene of a case under a method, and what is to be said of its step size."""
    base = case.base()
    own = base.method.position_based  # then substeps and iterations are the scene's
    if case.of_tetrahedra:
        solved = tetrahedral_budget(case, method)
    elif case.of_fluids:
        solved = {"method.scheme": method.split()[-1]}
    else:
        solved = {} if case.of_bodies else {"method.ordering": method.split()[-1]} if own else changes(method)
    scene = base.replace({**solved, **case.changes})
    limit, dt = stability_limit(scene), scene.method.dt
    if not case.own_step or dt <= limit or limit <= 0:
        return scene, ""
    held = float(f"{SAFE * limit:.3g}")
    return scene.replace({"method.dt": held}), f"at dt {held:g} s; {dt:g} s is over the limit of {limit:.4g} s"


def judge_case(case: HardCase, method: str, backend: str = "cpu", precision: str = "float64", **how: Any) -> Outcome:
    """Run one case and judge it. `how`: options of a Trial. A crash is a verdict, too; raises but for Ctrl-C only
    BackendUnavailable: of a solver that a backend has not."""
    scene, note = case_scene(case, method)
    trial = Trial(scene, backend, precision, **({"live": LIVE} | how))

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
    """What the door says to the scene as it is; None where it lets it in."""
    try:
        trial.open().close()
    except SoftlabError as error:
        return str(error)
    return None


@dataclass(frozen=True)
class _Work:
    """One run to do, and the description and source hash by which the store knows it."""

    case: HardCase
    method: str
    backend: str
    precision: str
    description: dict[str, Any]
    sources: str

    def __str__(self) -> str:
        return f"{self.case.name} {self.method} {self.precision} {self.backend}"


def _digest(case: HardCase) -> str:
    """A hash of the laws of its kind: a case that judges otherwise is run anew."""
    kinds = (case.of_bodies, BODY_LAWS), (case.of_tetrahedra, TETRAHEDRAL_LAWS), (case.of_fluids, FLUID_LAWS)
    names = next((files for holds, files in kinds if holds), LAWS)
    return source_digest(*(Path(__file__).parent / f"{name}.py" for name in names))


def _work(
    cases: Sequence[HardCase], methods: Sequence[str], backends: Sequence[str], precisions: Sequence[str]
) -> list[_Work]:
    """All runs, those that share machine code one after another."""
    found, laws = [], {case.name: _digest(case) for case in cases}
    for backend, precision, method, case in product(backends, precisions, methods, cases):
        if method in case.methods:
            scene, _ = case_scene(case, method)
            description = configuration(scene, backend=backend, precision=precision, **host_of(backend))
            sources = f"{source_hash(backend)}-{laws[case.name]}"
            found.append(_Work(case, method, backend, precision, description | {"hard": case.name}, sources))
    return found


def run_hard(
    store: Store,
    *,
    quick: bool = False,
    cases: Sequence[str] | None = None,
    integrators: Sequence[str] | None = None,
    backends: Sequence[str] | None = None,
    precisions: Sequence[str] | None = None,
    pictures: bool = True,
    progress: bool = True,
    command: str = "softlab hard",
) -> HardSummary:
    """Judge what the store lacks of the hard cases, and return all verdicts.

    `cases`: names or rows (`B5`); None: all. `integrators`: methods; None: all, or (`quick`) the hand-out's step, velocity
    Verlet and the first scheme of fluids, of whose cases then only some are run unless they are named. `precisions`: None:
    both, or (`quick`) float64. `backends`: cpu, gpu (None: all that are here). `pictures`: end states as PNG into the folder
    `hard` beside the store, where OpenGL is.

    Raises SceneError (an unknown name), BackendUnavailable (a backend that is not here), InputError (the store).
    """
    wanted = chosen(cases, [case.name for case in CASES], "--case", rows=True)
    names = chosen(
        integrators or (QUICK if quick else None),
        (*METHODS, MATCHING, *TETRAHEDRAL[1:], *FLUIDS),
        "--integrator",
        rows=True,
    )
    accurate = chosen(precisions or (QUICK_PRECISIONS if quick else None), list(PRECISIONS), "--precision")
    here, summary = backends_here(backends), HardSummary.begun(store, "hard cases")
    few = quick and not cases
    asked = [case for case in CASES if case.name in wanted and (case.quick or not few)]
    everything = _work(asked, names, here, accurate)
    ends: list[tuple[_Work, Outcome]] = []

    def held(work: _Work) -> bool:
        return store.has_measure(work.description, summary.machine, work.sources, VERDICT)

    def measure(group: Sequence[_Work], tell: Tell) -> None:
        for work in group:
            tell(str(work), 0)
            _judge(store, summary, work, here[0], ends)
            tell(str(work), 1)

    resume(store, summary, [[work] for work in everything], held, measure, progress=progress, command=command)
    with ending_cleanly(summary):
        if pictures and store.path != ":memory:" and not summary.interrupted:
            _draw(summary, ends, Path(store.path).absolute().parent / "hard", progress)
    summary.rows = rows_of(measures_of(store, summary.machine, (one.description for one in everything)))
    summary.stop()
    return summary


def _judge(store: Store, summary: HardSummary, work: _Work, first: str, ends: list[tuple[_Work, Outcome]]) -> None:
    """Checks, shape and verdict of one run into the store, all or none; what is to be drawn, to `ends`. Nothing of a solver
    that the backend has not."""
    try:
        outcome = judge_case(work.case, work.method, work.backend, work.precision)
    except BackendUnavailable:
        return
    drawn = outcome.end is not None and (
        outcome.verdict in ("fail", "known")
        or (work.backend == first and work.precision == "float64" and work.method in DRAWN)
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
        scene, _ = case_scene(work.case, work.method)
        numbers[SHAPE] = None, "m", _shape(scene, outcome.end)
        ends.append((work, outcome))
    numbers[VERDICT] = CODES[outcome.verdict], "", outcome.diagnosis
    keep(store, summary.run, work.description, work.sources, numbers)
    summary.measured += 1


def _shape(scene: Scene, end: Any) -> str:
    if scene.bodies:
        return bodies_as_text(end, scene.body_set.body)
    if scene.tetrahedra or scene.fluids:
        return bodies_as_text(end, np.zeros(len(end), int))
    return as_text(end, scene.grid.rows, scene.grid.columns)


def _draw(summary: HardSummary, ends: list[tuple[_Work, Outcome]], folder: Path, show: bool) -> None:
    """A picture of every end state that was kept; none where OpenGL is missing, which is said."""
    from app.output.offscreen import opengl_available, render_frame

    if not ends:
        return
    works, reason = opengl_available()
    if not works:
        summary.no_pictures = reason
        return
    folder.mkdir(exist_ok=True)
    with progress_bar(show) as bar:
        for work, outcome in bar.track(ends, description="pictures"):
            scene, _ = case_scene(work.case, work.method)
            words = [work.case.name.replace(" ", "-"), work.method, work.precision, work.backend]
            caption = f"{work.case.name}: {work.case.title}, {work.method}: {outcome.verdict}"
            picture = folder / f"{'-'.join(words)}.png"
            assert outcome.end is not None  # only such are drawn
            render_frame(scene, outcome.end, picture, 640, 480, caption=caption, time=outcome.time)
            summary.pictures += 1
