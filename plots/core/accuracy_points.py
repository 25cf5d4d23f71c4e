"""Accuracy runs as points: the error that a configuration reached, and the cost of a simulated second."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

from softlab.bench.experiments.accuracy.judgement import ERROR, GROWTH, HALF, SOLVER, UNRESOLVED
from softlab.bench.experiments.accuracy.points import CLOTHS, COPY, SCENES, AccuracyPoint, method_words, point
from softlab.bench.store.results import Measure, by_configuration
from softlab.bench.store.schema import tables_by_kind
from softlab.model.base.table import Table, Tables
from softlab.model.scene.scene import load_scene
from softlab.plots.core.data import Source

LABELS = {str(load_scene(name).grid.pinned): label for label, name in SCENES.items()}  # the scenes differ in their pins
CLOTH_SCENES = {label: load_scene(name).as_dict() for label, name in CLOTHS.items()}
MEASURES = (ERROR, HALF, UNRESOLVED, COPY, GROWTH, SOLVER)  # measures of a point
SIDE = load_scene("lab-curtain").grid.rows  # masses; runs of other sizes have the size in their label


class Point(AccuracyPoint):
    """One accuracy run with its names for figures and sentences; timed if its times are of the selected version of the
    code.
    """

    @property
    def name(self) -> str:
        """Name, e.g. `rk4, 5 ms, float64, CPU` or `xpbd jacobi, 4 iterations, 5 ms, ...`."""
        exact = "" if self.math == "fast" else f", {self.math}"
        method = method_words(self.integrator, self.iterations)
        return f"{method}, {1000 * self.dt:g} ms, {self.precision}{exact}, {self.backend.upper()}"


def points(source: Source, scene: str | None = None, math: str = "fast") -> list[Point]:
    """Return the accuracy runs of one machine in one math, of one scene (`S1`, `S2`, `S1-16`) or all, largest step
    first.
    """
    return [p for p in _points(source) if scene in (None, p.scene) and p.math == math]


@lru_cache(maxsize=16)  # every claim, figure and table calls it
def _points(source: Source) -> list[Point]:
    gathered = by_configuration(m for m in source.measures if m.name in MEASURES)
    entries = [entry for named in gathered if ERROR in named and (entry := _point(source, named))]
    return sorted(entries, key=lambda p: (p.scene, p.integrator, p.iterations or 0, p.backend, p.precision, -p.dt))


def _point(source: Source, named: dict[str, Measure]) -> Point | None:
    description = named[ERROR].description
    tables: Tables = description["scene"]
    label = _label(tables) if "end" not in description else None  # `softlab advise` uses end times of its own
    repeats = source.costs.get(
        named[ERROR].configuration
    )  # None: timed with another version of the code, or not at all
    accuracy_point = point(label, description, named, repeats) if label else None
    return Point(**vars(accuracy_point)) if accuracy_point else None


def _label(tables: Tables) -> str | None:
    """Return the scene's label, for a grid from its pins and size; None for a scene that is no accuracy scene."""
    grid = tables_by_kind(tables).get("grid")
    if grid is None:
        return next((label for label, known in CLOTH_SCENES.items() if _material(known) == _material(tables)), None)
    label, rows = LABELS.get(str(grid.get("pinned"))), grid.get("rows")
    if label is None or rows != grid.get("columns"):
        return None
    return label if rows == SIDE else f"{label}-{rows}"


def _material(tables: Tables) -> Table:
    """Return a scene's tables without those of its method."""
    return {name: table for name, table in tables.items() if name not in ("title", "method")}


def reaching(candidates: Sequence[Point], error: float) -> list[Point]:
    """Return the timed points with a resolved error of at most `error` spacings, cheapest first."""
    reached = [p for p in candidates if p.seconds is not None and p.error <= error and p.resolved]
    return sorted(reached, key=lambda p: p.seconds or 0.0)


def order_points(candidates: Sequence[Point], integrator: str) -> list[Point]:
    """Return the runs that determine an integrator's order: float64, finite, resolved, of the first backend with any."""
    for backend in ("cpu", "gpu"):
        runs = [
            p
            for p in candidates
            if (p.integrator, p.precision, p.backend) == (integrator, "float64", backend) and not p.diverged and p.error
        ]
        if runs:
            return runs
    return []


def observed_order(errors: Sequence[tuple[float, float]]) -> float | None:
    """Return the slope of log error against log dt of (dt, error) pairs, least squares; None with fewer than two."""
    usable = [(math.log(dt), math.log(error)) for dt, error in errors if error > 0 and math.isfinite(error)]
    if len(usable) < 2:
        return None
    mean_x = sum(x for x, _ in usable) / len(usable)
    mean_y = sum(y for _, y in usable) / len(usable)
    spread = sum((x - mean_x) ** 2 for x, _ in usable)
    return sum((x - mean_x) * (y - mean_y) for x, y in usable) / spread if spread else None
