"""The accuracy runs as points: what error a configuration reached, and what a simulated second of it cost.

An accuracy configuration is a run of S1 or S2 (`lab-curtain`, `lab-hammock`) with its measures by the names below. A
point is told from one of the sweep by its measure `seconds_per_simulated_second`, or `error_half`, or `not_resolved`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from bench.results import Measure
from plots.data import Source

ERROR = "accuracy_error"  # root mean square over the free masses, in spacings, against Newton's law
HALF = "accuracy_error_half"  # the same against the half-acceleration equation
COST = "seconds_per_simulated_second"
UNRESOLVED = "unresolved"  # 1: the error is below what the reference resolves
SCENES = {"top": "S1", "top-corners": "S2"}


@dataclass(frozen=True)
class Point:
    """One accuracy run. `error` in spacings against Newton's law, infinite when it diverged; `half`: against the
    half-acceleration equation, where that was asked; `seconds`: wall seconds a simulated second, None if untimed."""

    scene: str
    integrator: str
    dt: float
    precision: str
    math: str
    backend: str
    threads: int | None
    error: float
    half: float | None
    seconds: float | None
    resolved: bool
    note: str | None

    @property
    def diverged(self) -> bool:
        return not math.isfinite(self.error)


def points(source: Source, scene: str | None = None) -> list[Point]:
    """The accuracy runs of one machine, of one scene (`S1`, `S2`) or all, largest step first."""
    gathered: dict[str, dict[str, Measure]] = {}
    for measure in source.measures:
        if measure.name in (ERROR, HALF, COST, UNRESOLVED):
            gathered.setdefault(measure.configuration, {})[measure.name] = measure
    found = [_point(named) for named in gathered.values() if ERROR in named]
    result = [p for p in found if p is not None and scene in (None, p.scene)]
    return sorted(result, key=lambda p: (p.scene, p.integrator, p.backend, p.precision, -p.dt))


def _point(named: dict[str, Measure]) -> Point | None:
    error = named[ERROR]
    description = error.description
    tables: dict[str, Any] = description["scene"]
    kinds = {table.get("kind", name): table for name, table in tables.items() if isinstance(table, dict)}
    if error.value is None:
        return None
    half, cost, unresolved = (named.get(name) for name in (HALF, COST, UNRESOLVED))
    return Point(
        scene=SCENES.get(str(kinds["grid"].get("pinned")), "other"),
        integrator=kinds["method"]["integrator"],
        dt=kinds["method"]["dt"],
        precision=description["precision"],
        math=description["math"],
        backend=description["backend"],
        threads=description["threads"],
        error=error.value,
        half=half.value if half else None,
        seconds=cost.value if cost else None,
        resolved=not (unresolved and unresolved.value),
        note=error.reason,
    )


def pareto(candidates: Iterable[Point]) -> list[Point]:
    """The points that no other beats in both error and cost, cheapest first.

    Diverged and untimed ones do not compete.
    """
    entered = sorted(
        (p for p in candidates if p.seconds is not None and not p.diverged), key=lambda p: (p.seconds or 0.0, p.error)
    )
    front: list[Point] = []
    for point in entered:
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


def fastest(candidates: Sequence[Point], error: float) -> Point | None:
    """The cheapest point with at most `error` spacings of error; None where none reaches it."""
    reaching = [p for p in candidates if p.seconds is not None and p.error <= error]
    return min(reaching, key=lambda p: p.seconds or 0.0, default=None)


def observed_order(errors: Sequence[tuple[float, float]]) -> float | None:
    """The slope of log error against log dt of (dt, error) pairs, least squares; None with fewer than two."""
    usable = [(math.log(dt), math.log(error)) for dt, error in errors if error > 0 and math.isfinite(error)]
    if len(usable) < 2:
        return None
    mean_x = sum(x for x, _ in usable) / len(usable)
    mean_y = sum(y for _, y in usable) / len(usable)
    spread = sum((x - mean_x) ** 2 for x, _ in usable)
    return sum((x - mean_x) * (y - mean_y) for x, y in usable) / spread if spread else None
