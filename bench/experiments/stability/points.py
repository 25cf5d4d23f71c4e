"""Results of the stability runs: points of the map, measured edges, and the names of their measures in the store."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf, isfinite

from softlab.bench.experiments.stability.runs import DIVERGED, END, GROWS, OUTCOMES
from softlab.bench.measure.experiment import Summary
from softlab.bench.store.results import Measure, by_configuration
from softlab.bench.store.schema import Description, canonical
from softlab.model.core.families import stability_limit
from softlab.model.core.integrators import INTEGRATORS
from softlab.model.scene.scene import Scene

OUTCOME, STEP = "stability_outcome", "stability_step"
EDGE, LIMIT = "stability_edge", "stability_limit"
NAMES = (OUTCOME, STEP, EDGE, LIMIT)

STIFFNESS, DAMPING = 10.0, 0.03  # N/m and N s/m: constant while the other one is varied


@dataclass(frozen=True)
class Place:
    """Configuration of a run.

    `chain`: the chain of the tests, else the grid of the map; `dt` [s], `stiffness` [N/m], `damping` [N s/m]; `limit`
    [s]: for any state of the grid.
    """

    integrator: str
    backend: str
    precision: str
    chain: bool
    dt: float
    stiffness: float
    damping: float
    limit: float

    @property
    def who(self) -> tuple[str, str, str]:
        return self.integrator, self.backend, self.precision


@dataclass(frozen=True)
class MapPoint:
    """One point of the map; `code` as in bench/experiments/stability/runs.py.

    `step`: the first bad step of a run that diverged.
    """

    place: Place
    code: int
    step: int | None

    @property
    def diverged(self) -> bool:
        return self.code == DIVERGED

    @property
    def lost(self) -> bool:
        """True if the run diverged or was growing."""
        return self.code in (GROWS, DIVERGED)

    @property
    def over(self) -> bool:
        """True if the step size exceeds the analytic limit."""
        return self.place.dt > self.place.limit


@dataclass(frozen=True)
class Edge:
    """One edge found by bisection on a linear net: `measured` [s], and `analytic` [s] at the net's true frequency."""

    place: Place
    measured: float
    analytic: float

    @property
    def off(self) -> float:
        """Relative error, measured / analytic - 1."""
        return self.measured / self.analytic - 1 if self.analytic > 0 and isfinite(self.analytic) else inf


def place_of(description: Description) -> Place:
    """Return the position on the map of a configuration, as bench.store.results.configuration describes it."""
    return _place(canonical(description["scene"]), description["backend"], description["precision"])


@lru_cache(maxsize=16384)  # figures, tables and claims all call it
def _place(scene_text: str, backend: str, precision: str) -> Place:
    scene = Scene.stored(json.loads(scene_text))
    assert scene.springs is not None
    return Place(
        scene.method.integrator,
        backend,
        precision,
        scene.grid.columns == 1,
        scene.method.dt,
        scene.springs.stiffness,
        scene.damping.coefficient if scene.damping else 0.0,
        stability_limit(scene),
    )


def stability_of(all_measures: Iterable[Measure]) -> tuple[list[MapPoint], list[Edge]]:
    """Return the map's points and the edges among measures of one machine, in a fixed order."""
    points, edges = [], []
    for measures in by_configuration(measure for measure in all_measures if measure.name in NAMES):
        place = place_of(next(iter(measures.values())).description)
        outcome, step, edge, limit = (measures.get(name) for name in NAMES)
        if outcome and outcome.value is not None:
            at = None if step is None or step.value is None or outcome.value != DIVERGED else int(step.value)
            points.append(MapPoint(place, int(outcome.value), at))
        if edge and limit and edge.value is not None and limit.value is not None:
            edges.append(Edge(place, edge.value, limit.value))
    order = list(INTEGRATORS)

    def key(entry: MapPoint | Edge) -> tuple[object, ...]:
        at = entry.place
        return order.index(at.integrator), at.backend, at.precision, at.chain, at.stiffness, at.damping, at.dt

    return sorted(points, key=key), sorted(edges, key=key)


def disagreements(points: Sequence[MapPoint], between: str = "backend") -> tuple[int, int]:
    """Return (number of points at which one diverged and another did not, number of points with more than one run).
    `between` selects the comparison of backends or of precisions, all else being equal. The other outcomes differ by
    thresholds on speeds and count as one here.
    """
    groups: dict[Place, dict[str, bool]] = {}
    for point in points:
        at = point.place
        key = replace(at, backend="") if between == "backend" else replace(at, precision="")
        groups.setdefault(key, {})[at.backend if between == "backend" else at.precision] = point.diverged
    shared = [verdicts for verdicts in groups.values() if len(verdicts) > 1]
    return sum(len(set(verdicts.values())) > 1 for verdicts in shared), len(shared)


@dataclass
class StabilitySummary(Summary):
    """Summary of `run_stability`; `points`, `edges`: of all cases, with those that the store had before."""

    points: list[MapPoint] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)

    def rows(self) -> list[list[str]]:
        """Return a line of cells for each integrator, backend and precision; HEAD has the titles."""
        lines = []
        for who in dict.fromkeys([*(p.place.who for p in self.points), *(e.place.who for e in self.edges)]):
            points = [p for p in self.points if p.place.who == who]
            counts = [str(sum(p.code == code for p in points)) for code in range(len(OUTCOMES))]
            under = str(sum(p.diverged and not p.over for p in points))
            chain = {e.place.damping > 0: e for e in self.edges if e.place.who == who and e.place.chain}
            cells = [_edge_cell(chain.get(damped)) for damped in (False, True)]
            lines.append([*who, *counts, under, *cells])
        return lines

    def __str__(self) -> str:
        rows = [list(HEAD), *self.rows()]
        widths = [max(len(row[k]) for row in rows) for k in range(len(HEAD))]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        differing, shared = disagreements(self.points)
        lines.append(f"outcomes after {END:g} s of an 8 x 8 grid; edges by bisection on a linear chain, and off theory")
        if shared:
            lines.append(f"backends differ on what diverged at {differing} of {shared} points")
        return "\n".join([*lines, self.counts() + self.ending()])


HEAD = (
    "integrator", "backend", "precision", *OUTCOMES, "under the limit", "edge, undamped", "edge, damped",
)  # fmt: skip


def _edge_cell(edge: Edge | None) -> str:
    return "-" if edge is None else f"{edge.measured:.4g} s ({100 * edge.off:+.2f} %)"
