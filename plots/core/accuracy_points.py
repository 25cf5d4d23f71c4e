"""The accuracy runs as points: what error a configuration reached, and what a simulated second of it cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from bench.experiments.accuracy.methods import efforts, name_of
from bench.experiments.accuracy.points import (
    CLOTHS,
    COPY,
    COST,
    ERROR,
    GROWTH,
    HALF,
    REFUSED,
    SCENES,
    SOLVER,
    UNRESOLVED,
    end_of,
    method_words,
)
from bench.store.results import Measure
from model.scene.scene import load_scene
from plots.core.data import Source

LABELS = {str(load_scene(name).grid.pinned): label for label, name in SCENES.items()}  # the scenes differ in their pins
CLOTH_SCENES = {label: load_scene(name).as_dict() for label, name in CLOTHS.items()}
SIDE = load_scene("lab-curtain").grid.rows  # masses; runs of other sizes have it in their label


@dataclass(frozen=True)
class Point:
    """One accuracy run. `scene`: S1 to S6, S6-still, or S1-16 at 16 x 16 masses; `integrator`: the method's name; `error` in
    spacings against Newton's law, infinite when it diverged or was `refused` (chaotic by then); `half`: against the
    half-acceleration equation, where that was asked; `seconds`: wall seconds a simulated second, None if untimed; `copied`:
    with the state's copy to the host; `low`, `high`: the least and greatest of its repeats, where they are known; `growth`:
    of a disturbance up to then. Of position-based methods alone: `iterations` of a substep, and `solver`, the error to the
    same scheme with its iterations converged."""

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
    copied: float | None = None
    growth: float | None = None
    refused: bool = False
    iterations: int | None = None
    solver: float | None = None

    @property
    def diverged(self) -> bool:
        return not math.isfinite(self.error) and not self.refused

    @property
    def name(self) -> str:
        """`rk4, 5 ms, float64, CPU`; `xpbd jacobi, 4 iterations, 5 ms, ...`."""
        exact = "" if self.math == "fast" else f", {self.math}"
        method = method_words(self.integrator, self.iterations)
        return f"{method}, {1000 * self.dt:g} ms, {self.precision}{exact}, {self.backend.upper()}"


def points(source: Source, scene: str | None = None, math: str = "fast") -> list[Point]:
    """The accuracy runs of one machine in one math, of one scene (`S1`, `S2`, `S1-16`) or all, largest step first."""
    return [p for p in _points(source) if scene in (None, p.scene) and p.math == math]


@lru_cache(maxsize=16)  # every claim, figure and table asks
def _points(source: Source) -> list[Point]:
    gathered: dict[str, dict[str, Measure]] = {}
    for measure in source.measures:
        if measure.name in (ERROR, HALF, COST, UNRESOLVED, COPY, GROWTH, SOLVER):
            gathered.setdefault(measure.configuration, {})[measure.name] = measure
    found = [point for named in gathered.values() if ERROR in named and (point := _point(source, named))]
    return sorted(found, key=lambda p: (p.scene, p.integrator, p.iterations or 0, p.backend, p.precision, -p.dt))


def _point(source: Source, named: dict[str, Measure]) -> Point | None:
    error = named[ERROR]
    description = error.description
    tables: dict[str, Any] = description["scene"]
    kinds = {table.get("kind", name): table for name, table in tables.items() if isinstance(table, dict)}
    label = _label(tables, kinds) if "end" not in description else None  # `softlab advise` judges at times of its own
    if error.value is None or label is None:
        return None
    wanted = (HALF, COST, UNRESOLVED, COPY, GROWTH, SOLVER)
    half, cost, unresolved, copy, growth, solver = (named.get(name) for name in wanted)
    repeats = source.costs.get(error.configuration)
    if repeats is None:  # timed with another version of the code, or not at all
        cost = copy = None
    dt = kinds["method"]["dt"]
    return Point(
        scene=label,
        integrator=name_of(kinds["method"]),
        dt=dt,
        precision=description["precision"],
        backend=description["backend"],
        error=error.value,
        half=half.value if half else None,
        seconds=cost.value if cost else None,
        low=repeats.low / dt if repeats else None,
        high=repeats.high / dt if repeats else None,
        resolved=not (unresolved and unresolved.value),
        math=description["math"],
        copied=cost.value + copy.value / end_of(label)
        if cost and copy and cost.value and copy.value is not None
        else None,
        growth=growth.value if growth else None,
        refused=(error.reason or "").startswith(REFUSED),
        iterations=efforts(kinds["method"])[0],
        solver=solver.value if solver else None,
    )


def _label(tables: dict[str, Any], kinds: dict[str, Any]) -> str | None:
    """The scene's label, of a grid from its pins and size; None for a scene that is no accuracy scene."""
    if "grid" not in kinds:
        return next((label for label, known in CLOTH_SCENES.items() if _material(known) == _material(tables)), None)
    grid = kinds["grid"]
    label, rows = LABELS.get(str(grid.get("pinned"))), grid.get("rows")
    if label is None or rows != grid.get("columns"):
        return None
    return label if rows == SIDE else f"{label}-{rows}"


def _material(tables: dict[str, Any]) -> dict[str, Any]:
    """A scene's tables without how it is solved."""
    return {name: table for name, table in tables.items() if name not in ("title", "method")}


def reaching(candidates: Sequence[Point], error: float) -> list[Point]:
    """The timed points with at most `error` spacings of error, cheapest first."""
    found = [p for p in candidates if p.seconds is not None and p.error <= error]
    return sorted(found, key=lambda p: p.seconds or 0.0)


def order_points(found: Sequence[Point], integrator: str) -> list[Point]:
    """The runs that show an integrator's order: float64, finite, resolved, of the first backend that has any."""
    for backend in ("cpu", "gpu"):
        mine = [
            p
            for p in found
            if (p.integrator, p.precision, p.backend) == (integrator, "float64", backend) and not p.diverged and p.error
        ]
        if mine:
            return mine
    return []


def observed_order(errors: Sequence[tuple[float, float]]) -> float | None:
    """The slope of log error against log dt of (dt, error) pairs, least squares; None with fewer than two."""
    usable = [(math.log(dt), math.log(error)) for dt, error in errors if error > 0 and math.isfinite(error)]
    if len(usable) < 2:
        return None
    mean_x = sum(x for x, _ in usable) / len(usable)
    mean_y = sum(y for _, y in usable) / len(usable)
    spread = sum((x - mean_x) ** 2 for x, _ in usable)
    return sum((x - mean_x) * (y - mean_y) for x, y in usable) / spread if spread else None
