"""The lab's own solvers of tetrahedra as peers on a bar: position-based, and vertex block descent.

They solve the fixed corotated material, the lab's default, for which a position-based sweep leaves a smaller error; at
these strains, of 1e-3, the bar is the same.
"""

from __future__ import annotations

from softlab.app.driver import open_simulation
from softlab.bench.peers.bars.tip import BARS, NEAR, tetrahedra_refusal
from softlab.bench.peers.base import Opened
from softlab.bench.peers.lab_xpbd import LabSimulation, LabXpbd
from softlab.model.scene.scene import Scene


class LabTetrahedra(LabXpbd):
    """`substeps` x `iterations` per frame by one of the lab's solvers."""

    scenes = tuple(BARS)

    def __init__(self, backend: str, solver: str, substeps: int, iterations: int):
        super().__init__(backend, iterations)
        self.solver, self.substeps = solver, substeps
        self.name = f"softlab_tetrahedra_{solver}_{substeps}x{iterations}_{backend}"
        self.label = f"softlab {solver}, {substeps} x {iterations}"

    def refusal(self, scene: Scene) -> str | None:
        return tetrahedra_refusal(scene)

    def bound(self, scene: Scene, precision: str) -> float:
        return NEAR

    def open(self, scene: Scene, precision: str, threads: int) -> Opened:
        solved = scene.replace({
            "method.solver": self.solver, "method.substeps": self.substeps, "method.iterations": self.iterations,
            "beam.material": "fixed-corotated",
        })  # fmt: skip
        return LabSimulation(open_simulation(solved, self.backend, threads=threads, precision=precision))
