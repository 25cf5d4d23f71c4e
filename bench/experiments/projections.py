"""`softlab projections`: constraints per second that the position-based solvers project.

A projection is one constraint in one iteration: constraints x iterations x substeps over the time of a whole step
(prediction, projections, velocities). The sheet is that of `cloth-xpbd` in other sizes, hung by two corners, with the
springs of 4, 8 or 12 neighbours, 10 substeps of 10 or of 1 iteration, by coloured Gauss-Seidel and by Jacobi. The
scenes of PUBLISHED, whose published times are of a step, are timed too. Times as defined in
bench/measure/case_timing.py.
"""

from __future__ import annotations

from collections.abc import Sequence

from softlab.bench.measure import words
from softlab.bench.measure.case_timing import Case, Rates, Row, make_case
from softlab.bench.measure.declaration import PRECISION, Lines, Option, Part, Sentence
from softlab.model.base.errors import SceneError
from softlab.model.position_based.plan import constraint_count
from softlab.model.scene.scene import Scene, load_scene

SIZES = (32, 64, 128, 256, 512)  # rows and columns
QUICK_SIZES = (32, 128)
MOST = 32768  # rows and columns: 10⁹ masses
LARGE = (1024,)  # additional sizes on a GPU
QUICK_NEIGHBOURS = (4, 12)
NEIGHBOURS = {4: ("structural",), 8: ("structural", "shear"), 12: ("structural", "shear", "bending")}
ORDERINGS = ("gauss-seidel", "jacobi")
BUDGETS = ((10, 10), (10, 1))  # substeps, iterations
SUBSTEPS, QUOTED = 10, 256  # of the figure; rows and columns of the sheet whose rates are quoted
NAMES = {"gauss-seidel": "coloured Gauss-Seidel", "jacobi": "Jacobi"}
QUICK_BUDGETS = BUDGETS[:1]  # a single iteration is machine code of its own
# Scenes of the size and the iterations of published times of frames of cloth on a GPU. Details that the sources omit
# (masses, materials, other computations) differ, so that a ratio would only be an order of magnitude.
PUBLISHED: tuple[tuple[str, dict[str, int]], ...] = (
    # XPBD 2016, table 1 (Macklin, Mueller, Chentanez, MIG), GTX 1070: 0.97, 1.78, 3.34, 5.65 ms
    *(("cloth-xpbd", {"method.iterations": n}) for n in (20, 40, 80, 160)),
    # Small Steps 2019, figure 1 (Macklin et al., SCA), RTX 2080 Ti: 12.4 and 13.5 ms
    ("cloth-small-steps", {"method.substeps": 1, "method.iterations": 30}),
    ("cloth-small-steps", {}),
    # Flamenco (Mahesh, Corse), RTX 2080: 0.94 and 10.4 ms
    *(("cloth-flamenco", {"cloth.rows": n, "cloth.columns": n}) for n in (30, 300)),
)


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


def _square(row: Row) -> bool:
    return row.rows == row.columns and row.substeps == SUBSTEPS


# ---------------------------------------------------------------------- sentences


def rates(rows: Sequence[Row]) -> Part | None:
    """Projections per second of both orderings at one size."""
    quoted = {
        row.ordering: row.rate for row in reversed(rows)
        if _square(row) and (row.rows, row.neighbours, row.iterations) == (QUOTED, 4, 1)
    }  # fmt: skip
    texts = [
        f"{name} does {words.number(quoted[ordering] / 1e6)} million projections a second"
        for ordering, name in NAMES.items()
        if ordering in quoted
    ]
    return (words.listed(texts), {name: quoted[name] for name in NAMES if name in quoted}) if texts else None


def per_projection(rows: Sequence[Row]) -> Part | None:
    """Rate of Jacobi, all constraints at once, over that of Gauss-Seidel in colours, over all sizes."""
    pairs: dict[tuple[int, ...], dict[str, float]] = {}
    for row in filter(_square, rows):
        pairs.setdefault((row.rows, row.neighbours, row.iterations), {})[row.ordering] = row.rate
    ratios = [both["jacobi"] / both["gauss-seidel"] for both in pairs.values() if set(NAMES) <= set(both)]
    if not ratios:
        return None
    text = f"{words.number(min(ratios), 2)} to {words.times(max(ratios))} as many"
    return text, {"least": min(ratios), "most": max(ratios)}


# ---------------------------------------------------------------------- the experiment


class Projections(Rates):
    """Measure how many constraints per second the position-based solvers project, beside published cloth."""

    name = command = stage = "projections"
    example = "softlab projections --quick   (softlab projections --backend cpu --size 256)"
    quick_help = (
        "Two sizes, ten iterations, fewer neighbours and repeats, no published scenes: under a minute on two cores."
    )
    in_lab = True
    options = {"sizes": Option("--size", "Only sheets of N x N masses. Repeatable.", int), "precisions": PRECISION}
    step, rate, kernel = "projection_step", "projections_per_second", "projection_kernel"
    fields = {
        "rows": lambda row: row.scene.grid.rows,
        "columns": lambda row: row.scene.grid.columns,
        "particles": lambda row: row.scene.grid.particle_count,
        "neighbours": lambda row: 4 * len(row.scene.cloth_springs),
        "ordering": lambda row: row.scene.method.ordering,
        "substeps": lambda row: row.scene.method.substeps,
        "iterations": lambda row: row.scene.method.iterations,
        "budget": lambda row: f"{row.substeps} x {row.iterations}",
    }
    order = ("particles", "backend", "neighbours", "ordering", "-iterations")
    table = {
        "masses": lambda row: f"{row.rows} x {row.columns}", "neighbours": "neighbours", "ordering": "ordering",
        "backend": "backend", "kernel": "kernel", "budget": lambda row: row.budget,
        "step, ms": lambda row: f"{1e3 * row.step:.3g}", "million / s": lambda row: f"{row.rate / 1e6:.0f}",
    }  # fmt: skip
    note = "budget: substeps x iterations; million / s: constraints projected; softlab figures draws them"
    figure = Lines(
        title="Projections a second",
        caption=(
            "Constraints x iterations x substeps over the time of a step, 10 substeps of 10 iterations (solid) or of one "
            "(dashed), float32: a hanging sheet with the springs of 4 or 12 neighbours, by coloured Gauss-Seidel and by "
            "Jacobi. The whole step is timed, prediction and velocities included."
        ),
        x_label="masses",
        y_label="projections a second",
        styles={
            ("gauss-seidel", 4): ("Gauss-Seidel, 4 neighbours", "blue", "o"),
            ("gauss-seidel", 12): ("Gauss-Seidel, 12 neighbours", "green", "D"),
            ("jacobi", 4): ("Jacobi, 4 neighbours", "orange", "s"),
            ("jacobi", 12): ("Jacobi, 12 neighbours", "vermillion", "^"),
        },
        keys=lambda row: ((row.ordering, row.neighbours), row.iterations),
        dashes={10: "-", 1: "--"},
        select=_square,
    )
    sentences = {
        "projection-rates": Sentence(
            f"With springs to four neighbours, {QUOTED}{words.SPACE}{words.TIMES}{words.SPACE}{QUOTED} masses and 10 "
            "substeps of one iteration: {}.", rates, "Projections were not timed at this size.",
            form="on {place} {part}", join="; ".join,
        ),
        "projection-orderings": Sentence(
            "Jacobi projects {} as Gauss-Seidel does in the same time, over sizes and neighbours; what its iterations are "
            "worth is another question.", per_projection, "The two orderings were not timed side by side.",
        ),
    }  # fmt: skip

    def work(self, scene: Scene) -> float:
        """Return the number of projections per step."""
        return constraint_count(scene) * scene.method.substeps * scene.method.iterations

    def groups(
        self, backends: Sequence[str], quick: bool, precisions: Sequence[str], sizes: Sequence[int] = ()
    ) -> list[list[Case]]:
        """Return the groups timed in turn: all cases of a size and backend; then the published scenes.

        `sizes`: only these. `quick`: two sizes, 4 and 12 neighbours, ten iterations, no published scene. Raises SceneError
        for an impossible size.
        """
        for size in sizes:
            if size < 2:
                raise SceneError("--size", size, "must be at least 2: a sheet of one mass has no springs to project")
            if size > MOST:
                raise SceneError("--size", size, f"must be at most {MOST}")
        all_groups = []
        for backend in backends:
            usual = QUICK_SIZES if quick else (*SIZES, *(LARGE if backend == "gpu" else ()))
            for size in sizes or usual:
                all_groups.append(
                    [
                        case_of(sheet(size, neighbours, ordering, *budget), backend, precision)
                        for precision in precisions
                        for neighbours in (QUICK_NEIGHBOURS if quick else NEIGHBOURS)
                        for budget in (QUICK_BUDGETS if quick else BUDGETS)
                        for ordering in ORDERINGS
                    ]
                )
            if not sizes and not quick:
                published = [load_scene(name).replace(changes) for name, changes in PUBLISHED]
                all_groups += [[case_of(scene, backend, precisions[0])] for scene in published]
        return all_groups
