"""The same answer first: a peer's state held against the lab's CPU in float64, `exact`, at the very size that is timed."""

from __future__ import annotations

import math

import numpy as np

from app.driver import open_simulation
from bench.experiments.checks import displaced
from bench.measure.cases import SweepSummary
from bench.peers.cases import Beside, PeerCase
from bench.peers.results import DIFFERENCE
from bench.store.database import Store
from model.core.build import Body
from model.core.simulation import Simulation, State
from model.scene.scene import Scene


class Judge:
    """Checks contestants and stores how far each is off; keeps what is expected at the last size."""

    def __init__(self, store: Store, summary: SweepSummary):
        self.store, self.summary = store, summary
        self._expected: tuple[str, State, np.ndarray] | None = None  # scene, start, positions

    def check(self, case: PeerCase, simulation: Simulation | Beside, body: Body) -> str | None:
        """Store how far the state is from the expected one; what the samples must be marked with, or None."""
        steps = case.steps_checked
        start, expected = self._expect(case.scene, steps)
        simulation.load(start)
        simulation.advance(steps)
        simulation.synchronize()
        error, largest = distances(simulation.read("position"), expected, body, case.scene.grid.spacing)
        limit = case.bound
        note = f"own size, {steps} steps, against the lab's CPU in float64, exact; bound {limit:.2g}"
        run = self.summary.run
        with self.store.transaction():
            for name, value in ((DIFFERENCE, error), (f"{DIFFERENCE}_largest", largest)):
                self.store.add_measure(run, case.description, case.sources, name, value, "spacing", note)
        simulation.reset()
        if error <= limit:
            return None
        warning = f"wrong answer: {error:.2g} spacings off ({note})".replace("; ", ", ")
        self.summary.wrong.append((str(case), warning))
        return warning

    def _expect(self, scene: Scene, steps: int) -> tuple[State, np.ndarray]:
        """(a displaced start, the positions after `steps` steps), of the lab's CPU; once for each size."""
        key = scene.canonical()
        if self._expected is None or self._expected[0] != key:
            with open_simulation(scene, "cpu", precision="float64", math="exact") as judge:
                alone = scene.bodies or scene.tetrahedra  # begin apart from each other, or hang down as time goes on
                start = judge.state() if alone else displaced(judge)
                judge.load(start)
                judge.advance(steps)
                self._expected = (key, start, judge.state().position)
        return self._expected[1:]


def distances(position: np.ndarray, expected: np.ndarray, body: Body, spacing: float) -> tuple[float, float]:
    """(root mean square, maximum) over the free masses, in spacings; infinite where a value is not finite."""
    free = body.inverse_mass > 0
    if not free.any():
        return 0.0, 0.0
    offset = np.subtract(position, expected, dtype=np.float64)[free]
    squared = np.einsum("ij,ij->i", offset, offset)
    error, largest = math.sqrt(squared.mean()) / spacing, math.sqrt(squared.max()) / spacing
    return (error, largest) if math.isfinite(error) else (math.inf, math.inf)
