"""What the accuracy runs say: points of speed against error, their Pareto front, and the names of their measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

SCENES = {"S1": "lab-curtain", "S2": "lab-hammock"}
END = 1.5  # s: the horizon of both scenes

ERROR, LARGEST = "accuracy_error", "accuracy_error_largest"
HALF = "accuracy_error_half"
ENERGY, ENERGY_OFF, STRAIN = "accuracy_energy", "accuracy_energy_off", "accuracy_strain"
COST, UNRESOLVED, ESTIMATE = "seconds_per_simulated_second", "unresolved", "reference_estimate"


@dataclass(frozen=True)
class AccuracyPoint:
    """One configuration. `scene`: S1 or S2; `error`, `largest`: root mean square and maximum over the free masses, in
    spacings, against Newton's law, infinite when it diverged; `half`: against half the acceleration (`lab` alone);
    `energy` [J] and how far it is `energy_off` [J] the reference's; `strain`: the worst; `seconds`: wall time per
    simulated second, None if not timed; `resolved`: the reference is good enough to tell; `note`: how, or why not."""

    scene: str
    integrator: str
    dt: float
    precision: str
    backend: str
    threads: int | None
    error: float
    largest: float | None
    half: float | None
    energy: float | None
    energy_off: float | None
    strain: float | None
    seconds: float | None
    resolved: bool
    note: str | None

    @property
    def diverged(self) -> bool:
        return not math.isfinite(self.error)

    def __str__(self) -> str:
        cost = "not timed" if self.seconds is None else f"{self.seconds * 1e3:9.3f} ms a simulated second"
        return f"{self.error:8.2e}  {cost}  {self.integrator}, dt {self.dt:g} s, {self.precision}, {self.backend}"


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

    Points that diverged, were not timed or are not resolved do not compete. Of equal points the first one stands.
    """
    entered = [p for p in points if p.seconds is not None and math.isfinite(p.error) and p.resolved]
    front: list[Candidate] = []
    for point in sorted(entered, key=lambda p: (p.seconds or 0.0, p.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


@dataclass
class AccuracySummary:
    """What `run_accuracy` did. `machine`, `run`: keys in the store (`run` empty: nothing was to do); `points`: all of
    the grid of cases, those `held` in the store from before included; `seconds` of wall time; `interrupted`: Ctrl-C."""

    machine: str
    run: str = ""
    points: list[AccuracyPoint] = field(default_factory=list)
    measured: int = 0
    held: int = 0
    seconds: float = 0.0
    interrupted: bool = False

    def __str__(self) -> str:
        lines = []
        for label, name in SCENES.items():
            mine = [p for p in self.points if p.scene == label]
            if not mine:
                continue
            broken = sum(p.diverged for p in mine)
            lines.append(
                f"{label} ({name}) at {END:g} s: {len(mine)} runs, of which {broken} diverged; the Pareto front:"
            )
            lines += [f"  {point}" for point in pareto_front(mine)]
        lines.append(
            f"{self.measured} measured, {self.held} held in the store, {self.seconds:.0f} s"
            + ("; interrupted: the same command resumes" if self.interrupted else "")
        )
        return "\n".join(lines)


def point(label: str, description: Mapping[str, Any], named: Mapping[str, Any]) -> AccuracyPoint | None:
    """The point of one configuration from its measures by name (bench.results.Measure); None where it has no error.

    `label`: S1 or S2; `description`: as bench.results.configuration makes it.
    """
    if ERROR not in named or named[ERROR].value is None:
        return None
    values = {name: measure.value for name, measure in named.items()}
    kinds = {table.get("kind", name): table for name, table in description["scene"].items()}
    return AccuracyPoint(
        scene=label,
        integrator=kinds["method"]["integrator"],
        dt=kinds["method"]["dt"],
        precision=description["precision"],
        backend=description["backend"],
        threads=description["threads"],
        error=values[ERROR],
        largest=values.get(LARGEST),
        half=values.get(HALF),
        energy=values.get(ENERGY),
        energy_off=values.get(ENERGY_OFF),
        strain=values.get(STRAIN),
        seconds=values.get(COST),
        resolved=not values.get(UNRESOLVED),
        note=named[ERROR].reason,
    )
