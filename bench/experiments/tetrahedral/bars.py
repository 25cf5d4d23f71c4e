"""Rows of the store on bars of tetrahedra (`softlab tetrahedra`): one per setting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

from softlab.bench.experiments.tetrahedra import ELEMENTS, MESH_ERROR, MOTION_ERROR, SOLVER_ERROR, TETRAHEDRA
from softlab.bench.experiments.tetrahedral.cantilever import setting_of
from softlab.bench.keys.carried import is_older
from softlab.bench.measure.costs_timing import SECONDS
from softlab.bench.store.marks import is_wrong
from softlab.bench.store.results import Measure, results_of
from softlab.bench.store.versions import sources_of


@dataclass(frozen=True)
class Bar:
    """One setting of one bar.

    `elements` tetrahedra of `young` [Pa]; `seconds`: of a frame. Errors are relative: that of the solver at rest (NaN
    if it would have taken too long), that in motion, and that of the mesh. `suspect`: the time has a mark; `wrong`: the
    mark says that the state was wrong or incomplete, so that the time does not compete. `version`: of the kernels, empty
    where they are those of this code.
    """

    elements: int
    young: float
    solver: str
    substeps: int
    iterations: int
    backend: str
    precision: str
    seconds: float
    solver_error: float
    motion_error: float
    mesh_error: float
    suspect: bool
    wrong: bool = False
    version: str = ""

    @property
    def total_error(self) -> float:
        """Largest error of the sag at rest against the continuum: of the mesh and of the solver, |m| + (1 + m) |s|.

        A mesh is too stiff, and a solver that has not converged too soft: their signed sum would cancel by chance.
        """
        return abs(self.mesh_error) + (1 + self.mesh_error) * abs(self.solver_error)


def bars(stored: Sequence[Measure]) -> list[Bar]:
    """Return the bars from the measures, coarse meshes and soft bars first."""
    all_bars = []
    for one in results_of(stored, TETRAHEDRA):
        value = one.values
        if not value.keys() >= {MOTION_ERROR, MESH_ERROR, SECONDS, ELEMENTS}:
            continue
        tables, time = one.tables, one.measures[SECONDS]
        method = tables["method"]
        all_bars.append(
            Bar(
                round(value[ELEMENTS]), tables["tetrahedral_body"]["young_modulus"],
                setting_of(method), method["substeps"], method["iterations"], time.backend,
                time.description["precision"], value[SECONDS], value.get(SOLVER_ERROR, nan), value[MOTION_ERROR],
                value[MESH_ERROR], one.is_suspect(SECONDS), is_wrong(time.reason),
                sources_of(time) if is_older(time, time.configuration) else "",
            )
        )  # fmt: skip
    return sorted(
        all_bars, key=lambda b: (b.backend, b.precision, b.elements, b.young, b.solver, b.substeps * b.iterations)
    )


def of_one_version(measured: Sequence[Bar]) -> list[Bar]:
    """Return the bars of one version of the kernels, so that their times compare: the version with most meshes, then
    with most bars."""
    versions: dict[str, list[Bar]] = {}
    for bar in measured:
        versions.setdefault(bar.version, []).append(bar)
    return max(
        versions.values(), key=lambda version: (len({bar.elements for bar in version}), len(version)), default=[]
    )
