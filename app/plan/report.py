"""Content of `softlab plan`: the stages of a step in order, their bytes and operations, and the plan of each backend.

Two views of one step. Stage by stage (kernel `stages`) every stage has separate input and output arrays. A backend's
default kernel does all stages of a pass at once: it only moves the state, or less if it does several steps per transfer
through memory, and it computes some springs twice where that is cheaper than storing them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite

import numpy as np

from softlab.app.driver import BACKENDS
from softlab.app.plan.passes import BackendPlan
from softlab.app.plan.shared import BodiesPlan, PartitionsPlan, SharedPlan, SlabsPlan
from softlab.app.presentation import presentation_of
from softlab.model.base.components import named
from softlab.model.base.errors import SceneError
from softlab.model.core.families import family_of, stability_limit
from softlab.model.core.plan import Node, Plan, Stage
from softlab.model.core.simulation import PRECISIONS
from softlab.model.core.stability.limit import frequency_lines
from softlab.model.scene.scene import Scene


@dataclass(frozen=True)
class Row:
    """A line of the tree: a branch or, with a `stage`, a leaf. `runs`: number of times in a step; `depth`: below the
    whole step.

    `seconds`: measured of a step, over all masses, by backend.
    """

    name: str
    depth: int
    runs: int
    stage: Stage | None = None
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class PlanReport:
    """The content of `softlab plan` for a scene. `unknown`: backends whose choice is unavailable here, and why;
    `shared`: on several GPUs, if requested."""

    scene: Scene
    precision: str
    limit: float
    plan: Plan
    rows: tuple[Row, ...]
    backends: tuple[BackendPlan, ...]
    unknown: dict[str, str]
    shared: SharedPlan | BodiesPlan | PartitionsPlan | SlabsPlan | None = None

    @property
    def item(self) -> int:
        """Bytes per scalar."""
        return np.dtype(PRECISIONS[self.precision]).itemsize

    @property
    def springs(self) -> int:
        """Number of springs of the whole scene, of every kind; of a mesh its constraints."""
        return family_of(self.scene).spring_count(self.scene)

    @property
    def bytes(self) -> int:
        """Bytes per mass and step, stage by stage."""
        return sum(row.runs * row.stage.bytes(self.item, self.plan.dimensions) for row in self.rows if row.stage)

    @property
    def operations(self) -> int:
        """Operations per mass and step, stage by stage."""
        return sum(row.runs * row.stage.operations for row in self.rows if row.stage)

    def seconds(self, backend: str) -> float:
        """Return the measured seconds of a step, stage by stage; 0 without measurements."""
        return sum(row.seconds.get(backend, 0.0) for row in self.rows)

    def as_dict(self) -> dict[str, object]:
        """Return the object that `--json` prints. Fractions are of the whole step; an infinite limit is null."""
        method, grid = self.scene.method, self.scene.grid
        counts = presentation_of(self.scene).counts(self.scene)
        return {
            "scene": self.scene.name, "precision": self.precision, "particles": grid.particle_count,
            **counts, "springs": self.springs, "dimensions": self.plan.dimensions, "method": method.label,
            "substeps": method.substeps, "iterations": method.iterations,
            "dt": method.dt, "limit": self.limit if isfinite(self.limit) else None,
            "stable": method.dt <= self.limit, "frequency": frequency_lines(self.scene),
            "bytes": self.bytes, "operations": self.operations,
            "stages": [self._row_as_dict(row) for row in self.rows],
            "backends": {one.name: self._backend_as_dict(one) for one in self.backends},
            "unknown": self.unknown,
            **({"shared": self.shared.as_dict()} if self.shared else {}),
        }  # fmt: skip

    def _row_as_dict(self, row: Row) -> dict[str, object]:
        entry: dict[str, object] = {"name": row.name, "depth": row.depth, "runs": row.runs, "branch": row.stage is None}
        if row.stage is None:
            return entry
        moved, done = row.runs * row.stage.bytes(self.item, self.plan.dimensions), row.runs * row.stage.operations
        return entry | {
            "bytes": moved, "bytes_share": fraction(moved, self.bytes),
            "operations": done, "operations_share": fraction(done, self.operations),
            "seconds": row.seconds,
            "seconds_share": {name: fraction(value, self.seconds(name)) for name, value in row.seconds.items()},
        }  # fmt: skip

    def _backend_as_dict(self, one: BackendPlan) -> dict[str, object]:
        return {
            "device": one.device, "kernel": one.kernel, "tile": one.tile, "why": one.why,
            "passes": [
                {"stages": list(p.stages), "bytes": p.bytes, "operations": p.operations, "note": p.note}
                for p in one.passes
            ],
            "seconds": self.seconds(one.name) or None, "unmeasured": one.unmeasured,
            "empty_seconds": one.empty, "step_seconds": one.step,
        }  # fmt: skip


def fraction(part: float, whole: float) -> float:
    """Return part / whole, or 0 if `whole` is 0."""
    return part / whole if whole else 0.0


def flatten(root: Node) -> tuple[list[Row], list[int]]:
    """Return (the tree's lines from top to bottom, the lines of its leaves in the order of a step)."""
    rows: list[Row] = []

    def add(node: Node | Stage, depth: int, runs: int) -> list[int]:
        here = len(rows)
        if isinstance(node, Stage):
            rows.append(Row(node.name, depth, runs, node))
            return [here]
        rows.append(Row(node.name, depth, runs))
        below = [line for child in node.children for line in add(child, depth + 1, runs * node.times)]
        return below * node.times

    order = add(root, 0, 1)
    return rows, order


def plan_report(
    scene: Scene, precision: str = "float32", backends: Sequence[str] = BACKENDS, measure: bool = False
) -> PlanReport:
    """Return the report of a scene for the named backends; `measure`: with the time of every stage on available
    backends.

    Raises SceneError for an unknown word, and BackendUnavailable if the only backend to be measured is not available.
    """
    if precision not in PRECISIONS:
        raise SceneError("--precision", precision, f"must be one of {', '.join(PRECISIONS)}")
    for name in backends:
        if name not in BACKENDS:
            raise SceneError("--backend", name, f"must be one of {', '.join(BACKENDS)}")
    family = family_of(scene)
    plan = family.plan(scene, frozenset())
    rows, order = flatten(plan.root)
    plans, unknown = [], {}
    for name in backends:
        if name not in family.passes:
            unknown[name] = f"does not support scenes of the kind {family.name}"
            continue
        try:
            plans.append(named(family.passes[name])(scene, precision, plan))
        except ImportError as error:
            unknown[name] = f"no CUDA support is installed ({error})"
    if measure:
        from softlab.app.plan.measure import measure_stages

        for place, one in enumerate(plans):
            times = measure_stages(scene, one.name, precision, required=len(backends) == 1)
            plans[place] = replace(one, unmeasured=times.missing, empty=times.empty, step=times.step)
            for line, value in zip(order, times.seconds, strict=times.missing is None):
                rows[line].seconds[one.name] = rows[line].seconds.get(one.name, 0.0) + value
    return PlanReport(scene, precision, stability_limit(scene), plan, tuple(rows), tuple(plans), unknown)


def limit_line(report: PlanReport) -> str:
    """Return the stability limit, and the scene's step size relative to it."""
    method = report.scene.method
    state = "running at" if method.dt <= report.limit else "OVER THE LIMIT at"
    bound = f"limit dt {report.limit:.6g} s" if report.limit > 0 else "no stable dt"
    if report.limit == inf:
        bound = "no limit to dt"
    note = family_of(report.scene).note(report.scene)
    return f"{bound} ({method.name}: {note}), {state} {method.dt:g} s"
