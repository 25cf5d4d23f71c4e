"""Results of the accuracy runs: points of speed against error, their Pareto front, and the names of their measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from softlab.bench.experiments.accuracy import judgement
from softlab.bench.experiments.accuracy.equal_error import Fastest, Judged, equal_error
from softlab.bench.experiments.accuracy.methods import WRONG, efforts
from softlab.bench.experiments.growth import growth_words
from softlab.bench.measure.experiment import Summary
from softlab.bench.store.method_name import name_of
from softlab.bench.store.results import Measure, Timing
from softlab.bench.store.schema import Description, tables_by_kind
from softlab.model.base.errors import SceneError

SCENES = {"S1": "lab-curtain", "S2": "lab-hammock"}
SIZES = {"S1-16": ("S1", 16), "S1-64": ("S1", 64)}  # the same scene with other numbers of rows and columns
CLOTHS = {"S4": "cloth-wind", "S5": "cloth-drop", "S6": "rope-stiff", "S6-still": "rope-stiff-still"}
AT_REST = ("S6-still",)  # at rest at its end time, and compared with the closed form of the rest state
FAR = 1.0  # spacings: a larger error is no solution of the scene, at any price
END = 1.5  # s: end time of grids
CLOTH_ENDS = {"S4": 1.0, "S5": 0.5, "S6": 1.0, "S6-still": 12.0}  # s: end times of cloths and ropes

COST = "seconds_per_simulated_second"
SUSPECT_NOTE = "?: suspect, see docs/method/time.md"
COPY = "copy_seconds"  # copy of the whole state from the device to the host
MEASURED = {  # field of a point -> its measure
    "half": judgement.HALF, "growth": judgement.GROWTH, "energy_off": judgement.ENERGY_OFF,
    "strain_off": judgement.STRAIN_OFF, "mean_off": judgement.MEAN_OFF, "copy_seconds": COPY, "solver": judgement.SOLVER,
}  # fmt: skip


def end_of(label: str) -> float:
    """Return the time [s] at which the runs of a scene are compared with the reference."""
    return CLOTH_ENDS.get(label, END)


def labels_of(names: Iterable[str]) -> list[str]:
    """Return the labels of scenes that are named by label or by catalogue name, each once. Raises SceneError for
    others.
    """
    known, labels = SCENES | CLOTHS, []
    for name in names:
        matches = [label for label, scene in known.items() if name.lower() in (label.lower(), scene)]
        if not matches:
            raise SceneError(
                "--scene", name, "must be a scene with a converged reference: "
                f"{', '.join(f'{label} ({scene})' for label, scene in known.items())}; for other grids and cloths, softlab "
                "run and softlab advise report the error; for bodies, softlab bar compares the material with closed forms "
                "and softlab throughput measures the time"
            )  # fmt: skip
        labels += matches
    return list(dict.fromkeys(labels))


@dataclass(frozen=True)
class AccuracyPoint:
    """Result of one configuration.

    `scene`: a label of `SCENES`, `CLOTHS` or `SIZES`. `integrator`: the method's name
    (bench/experiments/accuracy/methods.py). `error` [spacings]: root mean square over the free masses of the distance to
    Newton's law, infinite if the run diverged or its error was refused. `half`: the error against half the acceleration
    (`lab` only). `growth`: the factor by which a disturbance of 1e-9 has grown by then. `energy_off` [J], `strain_off` (of
    the largest), `mean_off` (centre of mass, spacings): differences from the reference. `seconds`: wall time per simulated
    second, None if not timed; `low`, `high`: the smallest and largest of its repeats; `suspect`: the times are doubtful
    (other programs ran, the samples vary, they are short). `copy_seconds` [s]: copy of the state to the host, once per
    run. `resolved`: the reference is accurate enough for this error. `note`: how the error was computed, or why there is
    none.

    Only for position-based methods: `iterations`, `substeps`; `solver` [spacings]: the error to the same scheme with
    converged iterations (bench/experiments/accuracy/solver_error.py).
    """

    scene: str
    integrator: str
    dt: float
    precision: str
    backend: str
    error: float
    half: float | None
    seconds: float | None
    low: float | None
    high: float | None
    resolved: bool
    math: str = "fast"
    threads: int | None = None
    growth: float | None = None
    energy_off: float | None = None
    strain_off: float | None = None
    mean_off: float | None = None
    copy_seconds: float | None = None
    note: str | None = None
    iterations: int | None = None
    substeps: int | None = None
    solver: float | None = None
    suspect: bool = False

    @property
    def refused(self) -> bool:
        """True if the motion is chaotic by then, so that the error of a trajectory has no meaning."""
        return (self.note or "").startswith(judgement.REFUSED)

    @property
    def diverged(self) -> bool:
        return not math.isfinite(self.error) and not self.refused

    @property
    def copied(self) -> float | None:
        """`seconds` including the copy of the end state to the host."""
        if self.seconds is None or self.copy_seconds is None:
            return None
        return self.seconds + self.copy_seconds / end_of(self.scene)

    @property
    def run_seconds(self) -> float | None:
        """Time [s] of one run: from the start state on the device to the end state on the host, with launches and copy."""
        copied = self.copied
        return None if copied is None else copied * end_of(self.scene)

    @property
    def mark(self) -> str:
        """Suffix of a suspect time."""
        return "?" if self.suspect else ""

    @property
    def name(self) -> str:
        exact = "" if self.math == "fast" else f", {self.math}"
        return f"{method_words(self.integrator, self.iterations)}, dt {self.dt:g} s, {self.precision}{exact}, {self.backend}"

    def __str__(self) -> str:
        cost = "not timed" if self.seconds is None else f"{self.seconds * 1e3:9.3f}{self.mark} ms a simulated second"
        solver = "" if self.solver is None else f"; {self.solver:.1e} from its iterations"
        return f"{self.error:8.2e}  {cost}  {self.name}{solver}"


def method_words(name: str, iterations: int | None) -> str:
    """Return e.g. `xpbd jacobi, 4 iterations`; an integrator has its name only.

    A method that converges to another solution is marked.
    """
    if iterations is None:
        return name
    wrong = f" (to {WRONG[name]})" if name in WRONG else ""
    return f"{name}{wrong}, {iterations} iteration{'s' if iterations > 1 else ''}"


Candidate = TypeVar("Candidate", bound=Judged)


def pareto_front(points: Iterable[Candidate]) -> list[Candidate]:
    """Return the points that no other point beats in both error and seconds, cheapest first (by falling error).

    Points that diverged, were not timed or are not resolved do not compete, nor do points with an error beyond `FAR`,
    which say nothing about the scene. Of equal points the first one is returned.
    """
    entered = [p for p in points if p.seconds is not None and p.error <= FAR and p.resolved]
    front: list[Candidate] = []
    for point in sorted(entered, key=lambda p: (p.seconds or 0.0, p.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


@dataclass
class AccuracySummary(Summary):
    """Summary of `run_accuracy`; `points`: the whole grid of cases, with those that the store had before."""

    points: list[AccuracyPoint] = field(default_factory=list)

    def __str__(self) -> str:
        lines = []
        for label in (*SCENES, *SIZES, *CLOTHS):
            points = [p for p in self.points if p.scene == label]
            if points:
                lines += summary_lines(label, points)
        if any(p.suspect for p in self.points):
            lines.append(SUSPECT_NOTE)
        return "\n".join([*lines, self.counts() + self.ending()])


def summary_lines(label: str, points: list[AccuracyPoint]) -> list[str]:
    """Return the lines about one scene: how many runs diverged, the Pareto front, the fastest method at each error."""
    name = SCENES[SIZES[label][0]] if label in SIZES else (SCENES | CLOTHS)[label]
    sized = f", {SIZES[label][1]} x {SIZES[label][1]}" if label in SIZES else ""
    refused, broken = sum(p.refused for p in points), sum(p.diverged for p in points)
    heading = f"{label} ({name}{sized}) at {end_of(label):g} s: {len(points)} runs, of which {broken} diverged"
    growth = next((p.growth for p in points if p.growth is not None), None)
    if growth is not None:
        heading += f"; a disturbance of 1e-9 {growth_words(growth)}"
    if refused:
        return [f"{heading}: chaotic, the error of {refused} is refused", *(f"  {_statistics(p)}" for p in points)]
    lines = [f"{heading}; the Pareto front:", *(f"  {point}" for point in pareto_front(points))]
    return [*lines, "fastest way to an error (cost with the state's copy to the host in brackets):"] + [
        f"  {fastest_line(row)}" for row in equal_error(points)
    ]


def fastest_line(row: Fastest[AccuracyPoint]) -> str:
    """Return `1e-03 cpu 1.2 ms (1.2) velocity-verlet ...; gpu ...; at equal error the gpu is 2.1 times as fast (2.0)`."""
    texts = []
    for candidate, copied in ((row.cpu, row.cpu_copied), (row.gpu, row.gpu_copied)):
        if candidate is not None:
            cost = f"{1e3 * (candidate.seconds or 0.0):.3f}{candidate.mark} ms"
            cost += f" ({1e3 * copied.copied:.3f})" if copied is not None and copied.copied is not None else ""
            texts.append(f"{cost}  {candidate.name}")
    text = f"{row.target:.0e}  " + ("; ".join(texts) or "none of those measured")
    if row.speed_up is not None:
        text += f"; at equal error the gpu is {row.speed_up:.2g} times as fast"
        text += f" ({row.speed_up_copied:.2g})" if row.speed_up_copied is not None else ""
    return text


def _statistics(p: AccuracyPoint) -> str:
    """Return the text of a refused run: the statistics that are compared instead of the trajectory."""
    statistics = ((p.energy_off, "J energy"), (p.mean_off, "spacings centre of mass"), (p.strain_off, "worst strain"))
    parts = [f"{value:+.2e} {what}" for value, what in statistics if value is not None]
    return f"off by {', '.join(parts)}  {p.name}" if parts else f"{p.note}  {p.name}"


def point(
    label: str, description: Description, named: Mapping[str, Measure], repeats: Timing | None
) -> AccuracyPoint | None:
    """Return the point of one configuration from its measures by name, or None if there is no error among them.

    The measures are `bench.store.results.Measure`. `label`: as in `AccuracyPoint`; `description`: as
    bench.store.results.configuration returns it; `repeats`: its samples, without the marked ones if enough others are
    left; None if it was not timed.
    """
    error = named.get(judgement.ERROR)
    if error is None or error.value is None:
        return None
    values = {name: measure.value for name, measure in named.items()}
    method = tables_by_kind(description["scene"])["method"]
    iterations, substeps = efforts(method)
    fields: dict[str, Any] = {name: description[name] for name in ("precision", "backend", "threads", "math")}
    fields |= {field: values.get(name) for field, name in MEASURED.items()}
    return AccuracyPoint(
        scene=label,
        integrator=name_of(method),
        dt=method["dt"],
        error=error.value,
        **fields | _times(repeats, method["dt"]),
        resolved=not values.get(judgement.UNRESOLVED),
        note=error.reason,
        iterations=iterations,
        substeps=substeps,
    )


def _times(repeats: Timing | None, dt: float) -> dict[str, Any]:
    """Return the fields that come from the samples. The stored median is over all samples, disturbed ones included."""
    if repeats is None:
        return {"seconds": None, "copy_seconds": None, "low": None, "high": None}
    per_second = {"seconds": repeats.median / dt, "low": repeats.low / dt, "high": repeats.high / dt}
    return {**per_second, "suspect": bool(repeats.suspect)}
