"""`softlab ablate` of fluids: leave out one thing at a time and measure the effect on density and motion.

Particles of a fluid separate in any motion, so the distance of two states is meaningless. The runs are compared by the
mean density error, the centre of mass and the height at one time. A second run whose particles start `DISTURBED`
spacings off shows how far two runs of the same scene differ by then. A part that changes less than `CLEAR` times that,
and less than is visible, is not needed. All runs are timed in turn, from the scene's start.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

import numpy as np
from rich.console import Console

from softlab.app.driver import open_simulation
from softlab.bench.experiments.advise.ablation import ARITHMETIC, FINER, FULL, PART, Ablation, ablations
from softlab.bench.experiments.advise.fluids import end_of
from softlab.bench.measure.costs_timing import QUICK, SECONDS, Measures, Record, in_turn
from softlab.bench.measure.experiment import Report, Summary, backends_here, described, resume, store_measures
from softlab.bench.measure.items import cost_sources
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.measure.timing import Subject, prepare
from softlab.bench.store.database import Store
from softlab.model.base.errors import Diverged
from softlab.model.core.simulation import Simulation
from softlab.model.fluid.measure import compression, height
from softlab.model.scene.scene import Scene

FINDING = "ablate fluids"  # value of `finding`
OPTIONS = ("viscosity", "cohesion", "surface_tension", "vorticity_confinement", "drag", "free_surface_drag")
DISTURBED, SEED = 1e-6, 1  # spacings, of the start of the disturbed run
CLEAR = 3.0  # multiple of the difference between two runs of one scene
SEEN_PRESSED, SEEN_MOVED = 1.25, 0.25  # times the density error; spacings: smaller changes are not visible
PRESSES, RELIEVES, MOVES = "presses the fluid", "relieves the fluid", "changes the motion"  # verdicts
NOT_NEEDED, BREAKS = "not needed", "diverges"
DENSITY, CENTRE, HEIGHT = "ablation_density", "ablation_centre", "ablation_height"


@dataclass(frozen=True)
class Left:
    """Result of leaving out one thing.

    `density`: the mean density error; `centre` [spacings]: distance of the centre of mass from that of the full scene;
    `height` [m]; `seconds`: wall time per simulated second, None if the run diverged.
    """

    name: str
    kind: str
    backend: str
    density: float
    centre: float
    height: float
    seconds: float | None = None

    def verdict(self, full: Left, twin: Left, spacing: float) -> str:
        """Return the effect on the full scene, if it exceeds the difference of a disturbed run."""
        if not isfinite(self.density):
            return BREAKS
        higher, noisy = (abs(one.height - full.height) / spacing for one in (self, twin))
        if self.centre > max(CLEAR * twin.centre, SEEN_MOVED) or higher > max(CLEAR * noisy, SEEN_MOVED):
            return MOVES
        noise = CLEAR * abs(twin.density - full.density)
        if self.density > max(SEEN_PRESSED * full.density, full.density + noise):
            return PRESSES
        return RELIEVES if self.density < min(full.density / SEEN_PRESSED, full.density - noise) else NOT_NEEDED


@dataclass
class FluidAblation(Summary):
    """Summary; `tables`: for each backend the full scene, its disturbed run, and the runs without one thing."""

    title: str = ""
    spacing: float = 1.0  # m
    end: float = 0.0
    tables: list[tuple[Left, Left, list[Left]]] = field(default_factory=list)


def left_out(scene: Scene) -> Iterator[Ablation]:
    """Yield parts that any scene can leave out or replace by cheaper ones, and each effect of its fluids except the
    density constraint."""
    yield from (one for one in ablations(scene) if one.kind != FINER)
    for name, part in scene.fluids.items():
        for option in OPTIONS:
            if getattr(part, option):
                path = f"{name}.{option}"
                yield Ablation(f"without {path}", "no stage of it", PART, path, changes={path: 0.0})


def ablate_fluids(
    store: Store,
    scene: Scene,
    *,
    backends: Sequence[str] | None = None,
    time: float | None = None,
    progress: bool = True,
    command: str = "softlab ablate",
) -> FluidAblation:
    """Measure the effect of each part of a scene of fluids at `time` [s] (None: 1).

    Runs use float32 and fast math, as is usual for fluids; `float64` and `exact math` are rows. Ctrl-C ends cleanly.

    Raises SceneError (an impossible time), BackendUnavailable, InputError (the store), Diverged (the full scene).
    """
    end = end_of(scene, time)
    chosen = backends_here(backends)
    summary = FluidAblation.begun(store, "ablate")
    summary.title, summary.end, summary.spacing = scene.title, end, scene.fluid_set.spacing
    usual = [_usual(one) for one in left_out(scene)]

    def measure(group: Sequence[str], report: Report) -> None:
        for backend in group:
            work = _Work(store, summary, scene, backend, lambda text: report(text, 1))
            summary.tables.append(work.measured(usual))
            summary.measured += 1 + len(usual)

    return resume(
        store, summary, [[backend] for backend in chosen], lambda backend: False, measure, progress=progress,
        command=command, worth=lambda backend: 2 + len(usual),
    )  # fmt: skip


def _usual(one: Ablation) -> Ablation:
    """Return the ablation in float32 and fast math; cheaper arithmetic becomes the more expensive one."""
    if one.kind != ARITHMETIC:
        return replace(one, precision="float32", math="fast")
    if one.precision == "float32":
        return replace(one, name="float64", why="twice the bytes a number", precision="float64", math="fast")
    return replace(one, name="exact math", why="rounds every operation", precision="float32", math="exact")


@dataclass
class _Work:
    store: Store
    summary: FluidAblation
    scene: Scene
    backend: str
    report: Any

    def measured(self, usual: Sequence[Ablation]) -> tuple[Left, Left, list[Left]]:
        """Return (full scene, disturbed run, the runs without one thing). Raises Diverged if the full scene does."""
        results: list[Left] = []
        with ExitStack() as stack:
            subjects: list[tuple[int, Subject]] = []
            centre = None
            for number, one in enumerate((replace(FULL, precision="float32", math="fast"), *usual)):
                scene = one.of(self.scene)
                how: dict[str, Any] = {"precision": one.precision, "math": one.math}
                simulation = stack.enter_context(open_simulation(scene, self.backend, **how))
                self.report(one.name)
                left, place = self._run(simulation, one, centre)
                if number == 0:
                    if place is None:
                        simulation.check()
                    centre = place
                    twin, _ = self._run(simulation, replace(one, name="a disturbed twin"), centre, DISTURBED)
                    self.report("a disturbed twin")
                    simulation.reset()
                if place is not None:
                    description = described(scene, self.backend, FINDING, **how, spares=one.spares)
                    subject = prepare(Subject(simulation, description), QUICK.seconds, QUICK.most)
                    subjects.append((len(results), subject))
                results.append(left)
            record = Record(self.store, self.summary.run, cost_sources(self.backend, [__file__]))
            timed = in_turn(record, [subject for _, subject in subjects], QUICK.repeats)
        for (number, subject), numbers in zip(subjects, timed, strict=True):
            seconds = numbers[SECONDS][0]
            dt = subject.simulation.scene.method.dt
            results[number] = left = replace(results[number], seconds=None if seconds is None else seconds / dt)
            said: Measures = {
                DENSITY: (left.density, "", left.name), CENTRE: (left.centre, "spacing", left.name),
                HEIGHT: (left.height, "m", left.name),
            }  # fmt: skip
            store_measures(self.store, self.summary.run, subject.name, record.sources, said | numbers)
        return results[0], twin, results[1:]

    def _run(
        self, simulation: Simulation, one: Ablation, centre: np.ndarray | None, disturbed: float = 0.0
    ) -> tuple[Left, np.ndarray | None]:
        """Run to the end, then reset; return (result, centre of mass, None if it diverged)."""
        scene = simulation.scene
        simulation.reset()
        if disturbed:
            start = simulation.state()
            off = np.random.default_rng(SEED).uniform(-disturbed, disturbed, start.position.shape) * scene.grid.spacing
            simulation.load(replace(start, position=(start.position + off).astype(start.position.dtype)))
        try:
            simulation.advance(max(1, round(self.summary.end / scene.method.dt)))
            simulation.check()
            place = np.asarray(simulation.read("position"), np.float64)
        except Diverged:
            simulation.reset()
            return Left(one.name, one.kind, self.backend, np.inf, np.inf, np.inf), None
        simulation.reset()
        middle = place.mean(axis=0)
        away = 0.0 if centre is None else float(np.linalg.norm(middle - centre) / scene.grid.spacing)
        values = compression(scene, place)[0], away, height(scene, place)
        return Left(one.name, one.kind, self.backend, *values), middle


def print_fluid_ablation(console: Console, summary: FluidAblation) -> None:
    """Print a table for each backend, and a sentence."""
    for full, twin, some in summary.tables:
        lines = []
        for one in (full, twin, *some):
            verdict = "" if one in (full, twin) else one.verdict(full, twin, summary.spacing)
            times = f"{full.seconds / one.seconds:.2f}" if full.seconds and one.seconds else "-"
            numbers = (f"{100 * one.density:.2g}", f"{one.centre:.2g}", f"{one.height:.3g}")
            lines.append((one.name, verdict, times, *(numbers if isfinite(one.density) else "---")))
        heads = columns(("", "verdict"), ("times as fast", "density error, %", "centre moved, spacings", "height, m"))
        title = f"{summary.title}, on the {full.backend}, at {summary.end:g} s"
        print_table(
            console, heads, lines, "centre: off the full scene's; verdicts: beyond what a disturbed twin does", title
        )
        spare = [
            one.name.removeprefix("without ") for one in some if one.verdict(full, twin, summary.spacing) == NOT_NEEDED
        ]
        console.print(f"not needed: {', '.join(spare) or 'none of its parts'}", markup=False, soft_wrap=True)
    console.print(summary.counts() + summary.ending())
