"""`softlab projections`: constraints per second that the position-based solvers project.

A projection is one constraint in one iteration: constraints x iterations x substeps over the time of a whole step
(prediction, projections, velocities). The sheet is that of `cloth-xpbd` in other sizes, hung by two corners, with the
springs of 4, 8 or 12 neighbours, 10 substeps of 10 or of 1 iteration, by coloured Gauss-Seidel and by Jacobi. The
scenes of bench/store/published.py, whose published times are of a step, are timed too. Times as defined in
bench/measure/case_timing.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from softlab.bench.measure.case_timing import Case, RatePoint, Rates, make_case
from softlab.bench.measure.tables import columns, print_table
from softlab.bench.store.database import Store
from softlab.bench.store.published import PUBLISHED
from softlab.bench.store.results import Measure, measures
from softlab.bench.store.schema import canonical
from softlab.model.base.errors import SceneError
from softlab.model.position_based.plan import constraint_count
from softlab.model.scene.scene import Scene, load_scene

STAGE = "projections"  # stage of the samples in the store
STEP = "projection_step"  # s: the median of a step
RATE = "projections_per_second"  # 1/s
KERNEL = "projection_kernel"  # the name of the kernel is stored as the reason
SIZES = (32, 64, 128, 256, 512)  # rows and columns
QUICK_SIZES = (32, 128)
MOST = 32768  # rows and columns: 10⁹ masses
LARGE = (1024,)  # additional sizes on a GPU
QUICK_NEIGHBOURS = (4, 12)
NEIGHBOURS = {4: ("structural",), 8: ("structural", "shear"), 12: ("structural", "shear", "bending")}
ORDERINGS = ("gauss-seidel", "jacobi")
BUDGETS = ((10, 10), (10, 1))  # substeps, iterations
QUICK_BUDGETS = BUDGETS[:1]  # a single iteration is machine code of its own


def projections_of(scene: Scene) -> int:
    """Return the number of projections per step."""
    return constraint_count(scene) * scene.method.substeps * scene.method.iterations


def label_of(scene: Scene) -> str:
    """Return e.g. `64 x 64, jacobi, 10 x 1`."""
    grid, method = scene.grid, scene.method
    return f"{grid.rows} x {grid.columns}, {method.ordering}, {method.substeps} x {method.iterations}"


def sheet(size: int, neighbours: int, ordering: str, substeps: int, iterations: int) -> Scene:
    """Return the sheet of a case: `cloth-xpbd` of the same area with size x size masses and that many neighbours."""
    base = load_scene("cloth-xpbd")
    tables = base.as_dict()
    for kind in set(NEIGHBOURS[12]) - set(NEIGHBOURS[neighbours]):
        del tables[kind]
    scale, damping = base.grid.rows / size, base.damping
    assert damping is not None
    return Scene(tables, base.name).replace(
        {
            "cloth.rows": size, "cloth.columns": size, "cloth.spacing": base.grid.spacing * scale,
            "cloth.mass": base.grid.mass * scale**2, "damping.coefficient": damping.coefficient * scale**2,
            "method.ordering": ordering, "method.substeps": substeps, "method.iterations": iterations,
        }
    )  # fmt: skip


def case_of(scene: Scene, backend: str, precision: str) -> Case:
    """Return one configuration, with its label."""
    return make_case(scene, backend, precision, label_of(scene))


def groups(
    backends: Sequence[str], quick: bool, precisions: Sequence[str], sizes: Iterable[int] | None = None
) -> list[list[Case]]:
    """Return the groups timed in turn: all cases of a size and backend; then the published scenes.

    `sizes`: only these. `quick`: two sizes, 4 and 12 neighbours, ten iterations, no published scene. Raises SceneError
    for an impossible size.
    """
    for size in sizes or ():
        if size < 2:
            raise SceneError("--size", size, "must be at least 2: a sheet without springs has nothing to project")
        if size > MOST:
            raise SceneError("--size", size, f"must be at most {MOST}")
    all_groups = []
    for backend in backends:
        usual = QUICK_SIZES if quick else (*SIZES, *(LARGE if backend == "gpu" else ()))
        for size in tuple(sizes) if sizes is not None else usual:
            all_groups.append(
                [
                    case_of(sheet(size, neighbours, ordering, *budget), backend, precision)
                    for precision in precisions
                    for neighbours in (QUICK_NEIGHBOURS if quick else NEIGHBOURS)
                    for budget in (QUICK_BUDGETS if quick else BUDGETS)
                    for ordering in ORDERINGS
                ]
            )
        if sizes is None and not quick:
            all_groups += [[case_of(entry.ours(), backend, precisions[0])] for entry in PUBLISHED]
    return all_groups


RATES = run_projections = Rates("projections", STAGE, STEP, RATE, KERNEL, projections_of, groups)


# ---------------------------------------------------------------------- results from the store


def print_projections(console: Console, store: Store, machine: str) -> None:
    """Print a table of what was timed on a machine."""
    rows = (
        (
            f"{p.rows} x {p.columns}", str(p.neighbours), p.ordering, f"{p.backend}, {p.kernel}",
            f"{p.substeps} x {p.iterations}", f"{1e3 * p.step:.3g}", f"{p.rate / 1e6:.0f}",
        )
        for p in points(measures(store, machine=machine))
    )  # fmt: skip
    heads = columns(("masses", "neighbours", "ordering", "kernel"), ("budget", "step, ms", "million / s"))
    print_table(
        console, heads, rows,
        "budget: substeps x iterations; million / s: constraints projected; softlab figures draws them, with published ones",
    )  # fmt: skip


@dataclass(frozen=True)
class ProjectionPoint(RatePoint):
    """One sheet; `neighbours`: 4, 8 or 12; `scene`: canonical text."""

    rows: int
    columns: int
    neighbours: int
    ordering: str
    substeps: int
    iterations: int
    scene: str

    @property
    def particles(self) -> int:
        return self.rows * self.columns


def points(stored: Iterable[Measure]) -> list[ProjectionPoint]:
    """Return the points from the measures, smallest sheets first."""
    projection_points = []
    for by_name, scene, point in RATES.results(stored):
        grid, method = scene.grid, scene.method
        projection_points.append(
            ProjectionPoint(
                **vars(point), rows=grid.rows, columns=grid.columns, neighbours=4 * len(scene.cloth_springs),
                ordering=method.ordering, substeps=method.substeps, iterations=method.iterations,
                scene=canonical(by_name[RATE].description["scene"]),
            )
        )  # fmt: skip
    return sorted(projection_points, key=lambda p: (p.particles, p.backend, p.neighbours, p.ordering, -p.iterations))


def beside_published(timed: Sequence[ProjectionPoint]) -> list[tuple[Any, ProjectionPoint]]:
    """Return (published, ours of one backend and machine) for every published scene that was timed."""
    pairs = []
    for entry in PUBLISHED:
        pairs += [(entry, point) for point in timed if point.scene == entry.text]
    return pairs
