"""What `softlab plan` says: the stages of a step in order, what each moves and computes, and what a backend makes of them.

Two views of one step. Stage by stage (kernel `stages`) every stage reads and writes memory of its own. The kernel that a
backend chooses does all stages of a pass at once: it moves the state alone, or less where it does several steps in one
way through memory, and it computes some springs twice where that is cheaper than to carry them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from app.driver import BACKENDS
from model.errors import SceneError
from model.formulas.springs import OPERATIONS_SPRING_2D
from model.frequency import frequency_lines, scene_net
from model.integrators import integrators_for, stability_limit
from model.mesh_constraints import families
from model.plan import Node, Plan, Stage
from model.plans import scene_plan
from model.scene import Scene
from model.simulation import PRECISIONS

EACH_ONCE = 2.0  # springs a mass, each computed once: a grid's interior has as many right and below as masses
SPRINGS_OF_A_MASS = 4.0
POSITION_BASED_NOTE = "constraints are projected, at any step size; first order, and damped by it"


@dataclass(frozen=True)
class Row:
    """A line of the tree: a branch, or (`stage`) a leaf. `runs`: how often in a step; `depth`: below the whole step.

    `seconds`: measured of a step, over all masses, by backend.
    """

    name: str
    depth: int
    runs: int
    stage: Stage | None = None
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Pass:
    """What a kernel does in one pass: `stages` by name, in order. `bytes` through memory and `operations`, a mass and
    pass; `note` says what the pass is."""

    stages: tuple[str, ...]
    bytes: float
    operations: float
    note: str


def merged_pass(stages: Sequence[Stage], item: int, dimensions: int, note: str) -> Pass:
    """One pass that does all `stages`: values are `item` bytes, and what one stage hands the next stays on the way."""
    moved = max(stage.bytes(item, dimensions) for stage in stages)
    operations = sum(stage.operations for stage in stages)
    return Pass(tuple(stage.name for stage in stages), float(moved), float(operations), note)


@dataclass(frozen=True)
class BackendPlan:
    """What a backend makes of a step: on `device`, by `kernel` (its `tile`, where it has one) for the reason `why`.

    Where stages were to be measured: `unmeasured`, why they could not be; `empty`, seconds of a stage that does nothing.
    """

    name: str
    device: str
    kernel: str
    tile: str | None
    why: str
    passes: tuple[Pass, ...]
    unmeasured: str | None = None
    empty: float | None = None


@dataclass(frozen=True)
class PlanReport:
    """All that `softlab plan` tells of a scene. `unknown`: backends whose choice cannot be had here, and why."""

    scene: Scene
    precision: str
    limit: float
    plan: Plan
    rows: tuple[Row, ...]
    backends: tuple[BackendPlan, ...]
    unknown: dict[str, str]

    @property
    def item(self) -> int:
        """Bytes a scalar."""
        return np.dtype(PRECISIONS[self.precision]).itemsize

    @property
    def springs(self) -> int:
        """Of the whole scene, of every kind; of a mesh its constraints."""
        if self.scene.mesh:
            return sum(len(family.corners) for family in families(self.scene))
        if self.scene.cloth:
            return len(scene_net(self.scene).ends)
        return self.scene.grid.spring_count if self.scene.springs else 0

    @property
    def bytes(self) -> int:
        """Bytes a mass and step, stage by stage."""
        return sum(row.runs * row.stage.bytes(self.item, self.plan.dimensions) for row in self.rows if row.stage)

    @property
    def operations(self) -> int:
        """Operations a mass and step, stage by stage."""
        return sum(row.runs * row.stage.operations for row in self.rows if row.stage)

    def seconds(self, backend: str) -> float:
        """Measured seconds of a step, stage by stage; 0 where nothing was measured."""
        return sum(row.seconds.get(backend, 0.0) for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """The object that `--json` prints. Shares are of the whole step; a limit that is infinite is null."""
        method, grid = self.scene.method, self.scene.grid
        counts = {}
        if self.scene.bodies:
            clusters = self.scene.crowd.clusters
            counts = {
                "bodies": len(self.scene.crowd.copies),
                "clusters": clusters.count,
                "entries": len(clusters.indices),
            }
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
        }  # fmt: skip

    def _row_as_dict(self, row: Row) -> dict[str, Any]:
        found: dict[str, Any] = {"name": row.name, "depth": row.depth, "runs": row.runs, "branch": row.stage is None}
        if row.stage is None:
            return found
        moved, done = row.runs * row.stage.bytes(self.item, self.plan.dimensions), row.runs * row.stage.operations
        return found | {
            "bytes": moved, "bytes_share": share(moved, self.bytes),
            "operations": done, "operations_share": share(done, self.operations),
            "seconds": row.seconds,
            "seconds_share": {name: share(value, self.seconds(name)) for name, value in row.seconds.items()},
        }  # fmt: skip

    def _backend_as_dict(self, one: BackendPlan) -> dict[str, Any]:
        return {
            "device": one.device, "kernel": one.kernel, "tile": one.tile, "why": one.why,
            "passes": [
                {"stages": list(p.stages), "bytes": p.bytes, "operations": p.operations, "note": p.note}
                for p in one.passes
            ],
            "seconds": self.seconds(one.name) or None, "unmeasured": one.unmeasured,
            "empty_seconds": one.empty,
        }  # fmt: skip


def share(part: float, whole: float) -> float:
    """part / whole, 0 of nothing."""
    return part / whole if whole else 0.0


def flatten(root: Node) -> tuple[list[Row], list[int]]:
    """(the tree's lines from top to bottom, the lines of its leaves in the order in which a step runs them)."""
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


# ---------------------------------------------------------------------- what a kernel makes of the stages


def leaves(node: Node | Stage) -> Iterator[Stage]:
    """The stages below a node, or the one that it is."""
    yield from (node,) if isinstance(node, Stage) else node.stages()


def _merged(plan: Plan) -> list[list[Stage]]:
    """The stages of each pass that a fused kernel makes over the grid in a step, in order.

    Velocity Verlet's force at the end of a step is the next one's at its start, so that one pass does the end of one and
    the start of the next; its random force is taken for both.
    """
    children = plan.root.children
    if plan.has("second half kick"):
        first, last = (list(leaves(child)) for child in children if isinstance(child, Node))
        again = [stage for stage in first if stage.name == "external force"]
        kicks = {stage.name: stage for stage in plan.root.stages()}
        pins = [kicks["pins"]] if "pins" in kicks else []
        return [[*last, *again, kicks["second half kick"], kicks["first half kick and drift"], *pins]]
    if all(isinstance(child, Node) for child in children):  # the stages of a Runge-Kutta method
        return [list(leaves(child)) for child in children]
    return [list(plan.root.stages())]


def _passes(plan: Plan, item: int, springs: float, way: float, note: str) -> tuple[Pass, ...]:
    """`springs` computed a mass; `way`: of the bytes of a whole pass through memory, what one pass takes."""
    merged = _merged(plan)
    more_springs = (springs - EACH_ONCE) * OPERATIONS_SPRING_2D
    moved = way * plan.bytes(item) / len(merged)
    found = []
    for stages in merged:
        operations = float(sum(stage.operations for stage in stages))
        operations += more_springs * any(stage.name == "spring forces" for stage in stages)
        found.append(Pass(tuple(stage.name for stage in stages), moved, operations, note))
    if plan.has("second half kick"):
        found[0] = replace(found[0], note=note + "; the end of a step and the start of the next are one pass")
    return tuple(found)


def _cpu_plan(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    from cpu_backend.choice import LEVELS, default_kernel
    from cpu_backend.mass_spring import processor_name

    real = PRECISIONS[precision]
    kernel, why = default_kernel(scene, real)
    sums = scene.method.integrator == "rk4" or plan.parts & {"external", "manufactured", "poke", "alternating"}
    loops = "through rows of sums" if sums else "one loop along a row"
    note = {"tiled": f"{loops}, {LEVELS} steps in flight"}.get(kernel, f"{loops}, a band of rows a thread")
    way = 1 / LEVELS if kernel == "tiled" else 1.0
    passes = _passes(plan, np.dtype(real).itemsize, EACH_ONCE, way, note)
    return BackendPlan("cpu", processor_name(), kernel, None, why, passes)


def _gpu_plan(scene: Scene, precision: str, plan: Plan) -> BackendPlan:
    """Also where there is no GPU: then for the one that the table of kernels was measured on."""
    from gpu_backend.choice import MEASURED_LIMITS, MEASURED_ON, default_kernel
    from gpu_backend.device import gpu_available, simulated

    real = PRECISIONS[precision]
    available, device = gpu_available()
    if not available:
        device = f"none here; as on the {MEASURED_ON} of the table"
    limits = None if available and not simulated() else MEASURED_LIMITS
    kernel, tile, why = default_kernel(scene, real, limits)
    springs, way, note = SPRINGS_OF_A_MASS, 1.0, "one thread a mass"
    if tile is not None:
        from gpu_backend.tile_launch import blocks_of

        across, down = blocks_of(scene.grid.rows, scene.grid.columns, tile)
        springs = 3 + 1 / tile.strip
        note = f"{tile.strip} masses a thread" if tile.strip > 1 else "one thread a mass"
        halos = across * down * tile.masses / scene.grid.particle_count if across * down > 1 else 1.0
        if kernel == "one-block":
            way, note = 0.0, f"{note}, all on the chip"
        elif kernel == "resident":
            way = (halos - 1) / max(tile.halo, 1)
            note += f", {across} x {down} tiles on the chip, borders exchanged every {tile.halo} steps"
        else:
            way = (halos + 1) / 2 / tile.halo
            note += f", {tile.halo} steps for one way through memory"
        if halos > 1:
            note += f"; with the halos {halos:.2f} x the masses"
    passes = _passes(plan, np.dtype(real).itemsize, springs, way, note)
    return BackendPlan("gpu", device, kernel, tile.name if tile else None, why, passes)


def plan_report(
    scene: Scene, precision: str = "float32", backends: Sequence[str] = BACKENDS, measure: bool = False
) -> PlanReport:
    """The report of a scene for the named backends; `measure`: with the time of every stage, where a backend is there.

    Raises SceneError for a word that is none, and BackendUnavailable where the only backend asked to be measured is not
    there.
    """
    if precision not in PRECISIONS:
        raise SceneError("--precision", precision, f"must be one of {', '.join(PRECISIONS)}")
    for name in backends:
        if name not in BACKENDS:
            raise SceneError("--backend", name, f"must be one of {', '.join(BACKENDS)}")
    plan = scene_plan(scene)
    rows, order = flatten(plan.root)
    found, unknown = [], {}
    ways: dict[str, Callable[[Scene, str, Plan], BackendPlan]] = {"cpu": _cpu_plan, "gpu": _gpu_plan}
    if scene.mesh:
        from app.plan_mesh import mesh_on_cpu, mesh_on_gpu

        ways = {"cpu": mesh_on_cpu, "gpu": mesh_on_gpu}
    elif scene.bodies:
        from app.plan_xpbd import bodies_on_cpu, bodies_on_gpu

        ways = {"cpu": bodies_on_cpu, "gpu": bodies_on_gpu}
    elif scene.method.position_based:
        from app.plan_xpbd import xpbd_on_cpu, xpbd_on_gpu

        ways = {"cpu": xpbd_on_cpu, "gpu": xpbd_on_gpu}
    elif scene.cloth:
        from app.plan_cloth import cloth_on_cpu, cloth_on_gpu

        ways = {"cpu": cloth_on_cpu, "gpu": cloth_on_gpu}
    for name in backends:
        try:
            found.append(ways[name](scene, precision, plan))
        except ImportError as error:
            unknown[name] = f"no CUDA support is installed ({error})"
    if measure:
        from app.plan_measure import measure_stages

        for place, one in enumerate(found):
            times = measure_stages(scene, one.name, precision, required=len(backends) == 1)
            found[place] = replace(one, unmeasured=times.missing, empty=times.empty)
            for line, value in zip(order, times.seconds, strict=times.missing is None):
                rows[line].seconds[one.name] = rows[line].seconds.get(one.name, 0.0) + value
    return PlanReport(scene, precision, stability_limit(scene), plan, tuple(rows), tuple(found), unknown)


def limit_line(report: PlanReport) -> str:
    """The stability limit, and how the scene's step size stands to it."""
    method = report.scene.method
    state = "running at" if method.dt <= report.limit else "OVER IT at"
    bound = f"limit dt {report.limit:.6g} s" if report.limit > 0 else "no stable dt"
    if report.limit == inf:
        bound = "no limit to dt"
    note = POSITION_BASED_NOTE if method.position_based else integrators_for(report.scene)[method.integrator].note
    return f"{bound} ({method.name}: {note}), {state} {method.dt:g} s"
