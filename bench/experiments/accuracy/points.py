"""What the accuracy runs say: points of speed against error, their Pareto front, and the names of their measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from bench.experiments.accuracy import judgement
from bench.experiments.accuracy.equal_error import Fastest, equal_error
from bench.experiments.accuracy.methods import WRONG, efforts, name_of
from bench.measure.experiment import Summary
from bench.measure.growth import growth_words
from bench.store.results import Timing
from bench.store.schema import tables_by_kind
from model.core.errors import SceneError

SCENES = {"S1": "lab-curtain", "S2": "lab-hammock"}
SIZES = {"S1-16": ("S1", 16), "S1-64": ("S1", 64)}  # the same scene with other rows and columns
CLOTHS = {"S4": "cloth-wind", "S5": "cloth-drop", "S6": "rope-stiff", "S6-still": "rope-stiff-still"}
AT_REST = ("S6-still",)  # by then at rest, and judged against the closed form of that
FAR = 1.0  # spacings: an error beyond it is no answer, at any price
END = 1.5  # s: the horizon of grids
CLOTH_ENDS = {"S4": 1.0, "S5": 0.5, "S6": 1.0, "S6-still": 12.0}  # s: of cloths and ropes

COST = "seconds_per_simulated_second"
SUSPECT_NOTE = "?: suspect, see docs/method.md"
COPY = "copy_seconds"  # of the whole state, from the device to the host
MEASURED = {  # field of a point -> the measure that it is
    "largest": judgement.LARGEST, "half": judgement.HALF, "growth": judgement.GROWTH, "energy": judgement.ENERGY,
    "energy_off": judgement.ENERGY_OFF, "strain": judgement.STRAIN, "strain_off": judgement.STRAIN_OFF,
    "mean_off": judgement.MEAN_OFF, "momentum_off": judgement.MOMENTUM_OFF, "copy_seconds": COPY,
    "solver": judgement.SOLVER, "constraint": judgement.CONSTRAINT, "balance": judgement.BALANCE,
}  # fmt: skip


def end_of(label: str) -> float:
    """The time [s] at which runs of a scene are judged."""
    return CLOTH_ENDS.get(label, END)


def labels_of(names: Iterable[str]) -> list[str]:
    """The labels of scenes that are named by label or as in the catalogue, each once. Raises SceneError for others."""
    known, found = SCENES | CLOTHS, []
    for name in names:
        mine = [label for label, scene in known.items() if name.lower() in (label.lower(), scene)]
        if not mine:
            raise SceneError(
                "--scene", name, "accuracy has scenes of its own, those with converged references: "
                f"{', '.join(f'{label} ({scene})' for label, scene in known.items())}; of other grids and cloths softlab run "
                "and softlab advise tell the error; bodies have none: softlab bar holds their material against closed forms, "
                "softlab throughput times them"
            )  # fmt: skip
        found += mine
    return list(dict.fromkeys(found))


@dataclass(frozen=True)
class AccuracyPoint:
    """One configuration. `scene`: of SCENES, CLOTHS or SIZES; `integrator`: the method's name
    (bench/experiments/accuracy/methods.py);
    `error`, `largest`: root mean square and maximum over the free masses, in spacings, against Newton's law, infinite when
    it diverged or was refused; `half`: against half the acceleration (`lab` alone); `growth`: of a disturbance of 1e-9 up to
    then; `energy` [J]; `strain`: the worst; how far they, the centre of mass [spacings] and the momentum [kg m/s] are off
    the reference's; `seconds`: wall time per simulated second, None if not timed; `low`, `high`: the least and greatest of
    its repeats; `suspect`: something is wrong with them (other programs ran, they spread, they are short);
    `copy_seconds` [s]: of the state to the host, once a run; `resolved`: the
    reference is good enough to tell; `note`: how, or why not.

    Of position-based methods alone: `iterations`, `substeps`; `solver` [spacings]: the error to the same scheme with its
    iterations converged; residuals of one substep more, `constraint` [m] and `balance` [kg m]
    (bench/experiments/accuracy/solver_error.py)."""

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
    largest: float | None = None
    growth: float | None = None
    energy: float | None = None
    energy_off: float | None = None
    strain: float | None = None
    strain_off: float | None = None
    mean_off: float | None = None
    momentum_off: float | None = None
    copy_seconds: float | None = None
    note: str | None = None
    iterations: int | None = None
    substeps: int | None = None
    solver: float | None = None
    constraint: float | None = None
    balance: float | None = None
    suspect: bool = False

    @property
    def refused(self) -> bool:
        """The motion is chaotic by then, and no error of a trajectory means anything."""
        return (self.note or "").startswith(judgement.REFUSED)

    @property
    def diverged(self) -> bool:
        return not math.isfinite(self.error) and not self.refused

    @property
    def copied(self) -> float | None:
        """`seconds` with the copy of the end state to the host in it."""
        if self.seconds is None or self.copy_seconds is None:
            return None
        return self.seconds + self.copy_seconds / end_of(self.scene)

    @property
    def mark(self) -> str:
        """Behind a time that is suspect."""
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
    """`xpbd jacobi, 4 iterations`; an integrator is its name. A method that converges to something else says so."""
    if iterations is None:
        return name
    wrong = f" (to {WRONG[name]})" if name in WRONG else ""
    return f"{name}{wrong}, {iterations} iteration{'s' if iterations > 1 else ''}"


class Judged(Protocol):
    """What can stand in a Pareto front."""

    @property
    def error(self) -> float: ...
    @property
    def seconds(self) -> float | None: ...
    @property
    def resolved(self) -> bool: ...


Candidate = TypeVar("Candidate", bound=Judged)


def pareto_front(points: Iterable[Candidate]) -> list[Candidate]:
    """The points that no other beats in both error and seconds, cheapest first (and so by falling error).

    Points that diverged, were not timed or are not resolved do not compete, nor do those farther off than FAR, however
    cheap: they tell nothing of the scene. Of equal points the first one stands.
    """
    entered = [p for p in points if p.seconds is not None and p.error <= FAR and p.resolved]
    front: list[Candidate] = []
    for point in sorted(entered, key=lambda p: (p.seconds or 0.0, p.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


@dataclass
class AccuracySummary(Summary):
    """What `run_accuracy` did. `points`: all of the grid of cases, those `held` in the store from before included."""

    points: list[AccuracyPoint] = field(default_factory=list)

    def __str__(self) -> str:
        lines = []
        for label in (*SCENES, *SIZES, *CLOTHS):
            mine = [p for p in self.points if p.scene == label]
            if mine:
                lines += summary_lines(label, mine)
        if any(p.suspect for p in self.points):
            lines.append(SUSPECT_NOTE)
        return "\n".join([*lines, self.counts() + self.ending()])


def summary_lines(label: str, points: list[AccuracyPoint]) -> list[str]:
    """What is told of the points of one scene: how many broke, the Pareto front, the fastest way to each error."""
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
    """`1e-03  cpu 1.2 ms (1.2) velocity-verlet ...; gpu ...; at equal error the gpu is 2.1 times as fast (2.0)`."""
    ways = []
    for way, copied in ((row.cpu, row.cpu_copied), (row.gpu, row.gpu_copied)):
        if way is not None:
            cost = f"{1e3 * (way.seconds or 0.0):.3f}{way.mark} ms"
            cost += f" ({1e3 * copied.copied:.3f})" if copied is not None and copied.copied is not None else ""
            ways.append(f"{cost}  {way.name}")
    text = f"{row.target:.0e}  " + ("; ".join(ways) or "none of those measured")
    if row.speed_up is not None:
        text += f"; at equal error the gpu is {row.speed_up:.2g} times as fast"
        text += f" ({row.speed_up_copied:.2g})" if row.speed_up_copied is not None else ""
    return text


def _statistics(p: AccuracyPoint) -> str:
    """Of a refused run: what is compared instead of the trajectory."""
    told = ((p.energy_off, "J energy"), (p.mean_off, "spacings centre of mass"), (p.strain_off, "worst strain"))
    parts = [f"{value:+.2e} {what}" for value, what in told if value is not None]
    return f"off by {', '.join(parts)}  {p.name}" if parts else f"{p.note}  {p.name}"


def point(
    label: str, description: Mapping[str, Any], named: Mapping[str, Any], repeats: Timing | None
) -> AccuracyPoint | None:
    """The point of one configuration from its measures by name (bench.store.results.Measure); None where it has no error.

    `label`: as in AccuracyPoint; `description`: as bench.store.results.configuration makes it;
    `repeats`: the samples of it, of those that are not marked where there are enough; None: it was not timed.
    """
    error = named.get(judgement.ERROR)
    if error is None or error.value is None:
        return None
    values: dict[str, Any] = {name: measure.value for name, measure in named.items()}
    method = tables_by_kind(description["scene"])["method"]
    iterations, substeps = efforts(method)
    told: dict[str, Any] = {name: description[name] for name in ("precision", "backend", "threads", "math")}
    told |= {field: values.get(name) for field, name in MEASURED.items()}
    return AccuracyPoint(
        scene=label,
        integrator=name_of(method),
        dt=method["dt"],
        error=error.value,
        **told | _times(repeats, method["dt"]),
        resolved=not values.get(judgement.UNRESOLVED),
        note=error.reason,
        iterations=iterations,
        substeps=substeps,
    )


def _times(repeats: Timing | None, dt: float) -> dict[str, Any]:
    """The fields that come from the samples. The stored median is of all of them, disturbed ones included."""
    if repeats is None:
        return {"seconds": None, "copy_seconds": None, "low": None, "high": None}
    per_second = {"seconds": repeats.median / dt, "low": repeats.low / dt, "high": repeats.high / dt}
    return {**per_second, "suspect": bool(repeats.suspect)}
