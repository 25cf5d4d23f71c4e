"""How many constraints a second the position-based solvers project: `softlab projections`.

A projection is one constraint in one iteration: constraints x iterations x substeps over the time of a step, all of it
(prediction, projections, velocities). The sheet is that of `cloth-xpbd` in other sizes, hung by two corners, with the
springs of 4, 8 or 12 neighbours, 10 substeps of 10 or of 1 iteration, by coloured Gauss-Seidel and by Jacobi. Beside it the
scenes of bench/published.py, whose published times are of a step.

Timed as bench/timing.py says: checked states, interleaved, resumable.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from app.driver import open_simulation
from bench.machine import enter_machine, gpu_simulated, source_revision
from bench.progress import progress_bar
from bench.published import NEWTON_ITERATION, PUBLISHED
from bench.results import Measure, configuration
from bench.store import Store
from bench.sweep import backends_here, host_of, source_hash
from bench.timing import Neighbours, Subject, choose_steps, interleaved, warm_up
from model.errors import Diverged, SceneError
from model.scene import Scene, load_scene
from model.simulation import PRECISIONS
from model.xpbd_plan import constraint_count

STAGE = "projections"  # of the samples in the store
STEP = "projection_step"  # s: the median of a step
RATE = "projections_per_second"  # 1/s
KERNEL = "projection_kernel"  # its name is the reason
SIZES = (32, 64, 128, 256, 512)  # rows and columns
QUICK_SIZES = (32, 128)
LARGE = (1024,)  # more of them on a GPU
NEIGHBOURS = {4: ("structural",), 8: ("structural", "shear"), 12: ("structural", "shear", "bending")}
ORDERINGS = ("gauss-seidel", "jacobi")
BUDGETS = ((10, 10), (10, 1))  # substeps, iterations
REPEATS, QUICK_REPEATS = 7, 3
SAMPLE_SECONDS, MOST_SAMPLE = 0.05, 3.0


@dataclass(frozen=True)
class Case:
    """One configuration, and the description and source hash by which the store knows it."""

    scene: Scene
    backend: str
    description: dict[str, Any]
    sources: str

    @property
    def projections(self) -> int:
        """Of a step."""
        method = self.scene.method
        return constraint_count(self.scene) * method.substeps * method.iterations

    def __str__(self) -> str:
        grid, method = self.scene.grid, self.scene.method
        return (
            f"{grid.rows} x {grid.columns}, {method.ordering}, {method.substeps} x {method.iterations}, {self.backend}"
        )


@dataclass
class ProjectionsSummary:
    """What `run_projections` did: configurations timed now, and found in the store; those that could not run."""

    machine: str
    run: str = ""
    measured: int = 0
    held: int = 0
    seconds: float = 0.0
    skipped: list[str] | None = None
    interrupted: bool = False

    def __str__(self) -> str:
        text = f"projections: {self.measured} timed, {self.held} held in the store, {self.seconds:.0f} s"
        for reason in self.skipped or ():
            text += f"\n  left out: {reason}"
        return text + ("\n  interrupted: the same command resumes" if self.interrupted else "")


def sheet(size: int, neighbours: int, ordering: str, substeps: int, iterations: int) -> Scene:
    """The sheet of a case: `cloth-xpbd`, size x size masses, as large as it, with the springs of so many neighbours."""
    base = load_scene("cloth-xpbd")
    tables = base.as_dict()
    for kind in set(NEIGHBOURS[12]) - set(NEIGHBOURS[neighbours]):
        del tables[kind]
    scale, damping = base.grid.rows / size, base.damping
    assert damping is not None
    return Scene(tables, base.name).replace(
        {
            "cloth.rows": size, "cloth.columns": size, "cloth.spacing": base.grid.spacing * scale,
            "cloth.mass": base.grid.mass * scale**2, "damping.coefficient": damping.coefficient * scale**2,
            "method.ordering": ordering, "method.substeps": substeps, "method.iterations": iterations,
        }
    )  # fmt: skip


def make_case(scene: Scene, backend: str, precision: str) -> Case:
    """One configuration, described as the store holds it."""
    description = configuration(scene, backend=backend, precision=precision, **host_of(backend))
    return Case(scene, backend, description, source_hash(backend))


def groups(
    backends: Sequence[str], quick: bool, sizes: Iterable[int] | None, precisions: Sequence[str]
) -> list[list[Case]]:
    """What is timed in turn: all cases of a size and backend; then the published scenes."""
    found = []
    for backend in backends:
        usual = QUICK_SIZES if quick else (*SIZES, *(LARGE if backend == "gpu" else ()))
        for size in tuple(sizes) if sizes is not None else usual:
            found.append(
                [
                    make_case(sheet(size, neighbours, ordering, *budget), backend, precision)
                    for precision in precisions
                    for neighbours in ((4, 12) if quick else NEIGHBOURS)
                    for budget in BUDGETS
                    for ordering in ORDERINGS
                ]
            )
        if sizes is None and not quick:
            found += [[make_case(entry.ours(), backend, precisions[0])] for entry in PUBLISHED]
    return found


def run_projections(
    store: Store,
    *,
    quick: bool = False,
    backends: Sequence[str] | None = None,
    sizes: Iterable[int] | None = None,
    precisions: Sequence[str] = ("float32",),
    progress: bool = True,
    command: str = "softlab projections",
) -> ProjectionsSummary:
    """Time what the store lacks of the cases, and say what was done. Ctrl-C ends cleanly.

    `quick`: two sizes, 4 and 12 neighbours, nothing published. Raises SceneError (a size or precision that cannot be),
    BackendUnavailable, InputError (the store).
    """
    begin = time.perf_counter()
    here = backends_here(backends)
    for size in sizes or ():
        if size < 2:
            raise SceneError("--size", size, "must be at least 2: a sheet without springs has nothing to project")
    for precision in precisions:
        if precision not in PRECISIONS:
            raise SceneError("--precision", precision, f"must be one of {', '.join(PRECISIONS)}")
    repeats = QUICK_REPEATS if quick else REPEATS
    summary = ProjectionsSummary(enter_machine(store), skipped=[])
    everything = groups(here, quick, sizes, precisions)
    missing = [[case for case in group if not _held(store, case, summary.machine, repeats)] for group in everything]
    missing = [group for group in missing if group]
    summary.held = sum(map(len, everything)) - sum(map(len, missing))
    try:
        if missing:
            summary.run = store.start_run(summary.machine, command, source_revision())
            with progress_bar(progress) as bar:
                task = bar.add_task("projections", total=sum(map(len, missing)))
                for group in missing:
                    bar.update(task, description=str(group[0]))
                    _time(store, summary, group, repeats)
                    bar.advance(task, len(group))
    except KeyboardInterrupt:
        summary.interrupted = True
    summary.seconds = time.perf_counter() - begin
    return summary


def _held(store: Store, case: Case, machine: str, repeats: int) -> bool:
    key = case.description, machine, case.sources
    return store.has_measure(*key, RATE) and store.sample_count(*key, STAGE) >= repeats


def _time(store: Store, summary: ProjectionsSummary, group: Sequence[Case], repeats: int) -> None:
    """Time one group in turn, and store its samples and rates."""
    with ExitStack() as stack:
        subjects = []
        for case in group:
            simulation = stack.enter_context(
                open_simulation(case.scene, case.backend, precision=case.description["precision"])
            )
            subject = Subject(simulation, case)
            try:
                warm_up(subject)
                choose_steps(subject, SAMPLE_SECONDS, MOST_SAMPLE)
            except Diverged as error:
                assert summary.skipped is not None
                summary.skipped.append(f"{case}: {error}")
                continue
            subjects.append(subject)
        taken: dict[int, list[float]] = {}
        for subject, sample in interleaved(subjects, [repeats] * len(subjects), Neighbours()):
            case = subject.name
            marks = [sample.suspect, "CUDA simulator, no GPU" if case.backend == "gpu" and gpu_simulated() else None]
            key = summary.run, case.description, case.sources
            store.add_sample(
                *key, sample.seconds, sample.steps, stage=STAGE, suspect="; ".join(filter(None, marks)) or None
            )
            times = taken.setdefault(id(subject), [])
            times.append(sample.seconds / sample.steps)
            if len(times) == repeats:
                step = statistics.median(times)
                store.add_measure(*key, STEP, step, "s", f"median of {repeats}")
                store.add_measure(*key, KERNEL, None, "", subject.simulation.kernel)
                store.add_measure(*key, RATE, case.projections / step, "1/s", None)
                summary.measured += 1


# ---------------------------------------------------------------------- what the store says


@dataclass(frozen=True)
class ProjectionPoint:
    """One timed configuration: `step` [s], `rate` [1/s], and what tells it apart. `neighbours` 4, 8 or 12."""

    machine: str
    backend: str
    precision: str
    kernel: str
    rows: int
    columns: int
    neighbours: int
    ordering: str
    substeps: int
    iterations: int
    scene: str  # canonical text
    step: float
    rate: float

    @property
    def iteration(self) -> float:
        """Seconds of an iteration, with its share of everything else in the step."""
        return self.step / self.substeps / self.iterations


def points(held: Iterable[Measure]) -> list[ProjectionPoint]:
    """What the measures tell of the cases, smallest sheets first."""
    named: dict[tuple[str, str], dict[str, Measure]] = {}
    for measure in held:
        if measure.name in (STEP, RATE, KERNEL):
            named.setdefault((measure.machine, measure.configuration), {})[measure.name] = measure
    found = []
    for (owner, _), told in named.items():
        if not {STEP, RATE} <= set(told):
            continue
        description = told[RATE].description
        scene = Scene(description["scene"])
        kinds, method = scene.cloth_springs, scene.method
        kernel = told[KERNEL].reason if KERNEL in told else None
        found.append(
            ProjectionPoint(
                owner, description["backend"], description["precision"], kernel or "", scene.grid.rows,
                scene.grid.columns, 4 * len(kinds), method.ordering, method.substeps, method.iterations,
                scene.canonical(), told[STEP].value or 0.0, told[RATE].value or 0.0,
            )
        )  # fmt: skip
    return sorted(found, key=lambda p: (p.rows * p.columns, p.backend, p.neighbours, p.ordering, -p.iterations))


def beside_published(found: Sequence[ProjectionPoint]) -> list[tuple[Any, ProjectionPoint]]:
    """(published, ours of one backend and machine) for every published scene that was timed here."""
    pairs = []
    for entry in PUBLISHED:
        text = entry.ours().canonical()
        pairs += [(entry, point) for point in found if point.scene == text]
    return pairs


def newton_ratios(found: Sequence[ProjectionPoint]) -> list[tuple[int, float]]:
    """(size, Newton's seconds of an iteration over ours) of twelve neighbours by Gauss-Seidel, 10 x 10, on a GPU."""
    return [
        (point.rows, NEWTON_ITERATION[point.rows] / point.iteration)
        for point in found
        if point.backend == "gpu" and point.rows == point.columns and point.rows in NEWTON_ITERATION
        and (point.neighbours, point.ordering, point.substeps, point.iterations) == (12, "gauss-seidel", 10, 10)
    ]  # fmt: skip
