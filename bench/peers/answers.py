"""Check of a peer's state against the lab's CPU in float64, `exact`, at the very size that is timed."""

from __future__ import annotations

import math
import time

import numpy as np

from softlab.app.driver import open_simulation
from softlab.bench.experiments.checks import displaced
from softlab.bench.measure.cases import SweepSummary
from softlab.bench.peers.bars.tip import Tip
from softlab.bench.peers.base import PeerError
from softlab.bench.peers.cases import Beside, PeerCase
from softlab.bench.peers.results import DIFFERENCE, PEER_LAW_DIFFERENCE
from softlab.bench.store.database import Store
from softlab.model.core.build import Body
from softlab.model.core.simulation import Simulation, State
from softlab.model.scene.scene import Scene


class Judge:
    """Checks contestants and stores their errors; caches the expected state of the last size."""

    def __init__(self, store: Store, summary: SweepSummary, most: float = math.inf):
        """`most`: longest time [s] of a run whose exact result is known beforehand."""
        self.store, self.summary, self.most = store, summary, most
        self._expected: tuple[str, State, np.ndarray] | None = None  # scene, start, positions

    def check(self, case: PeerCase, simulation: Simulation | Beside, body: Body) -> str | None:
        """Store the distance of the state from the expected one; return the mark of the samples, or None."""
        if case.exact is not None:
            return self._tip(case, simulation, case.exact(case.scene))
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

    def _tip(self, case: PeerCase, simulation: Simulation | Beside, exact: Tip) -> str | None:
        """Check a bar whose exact result is known like `check`; a peer with a law of its own is compared with that.

        Raises PeerError if the run would take longer than a configuration may.
        """
        peer_tip = case.peer.tip(case.scene) if case.peer is not None else None
        judge = peer_tip or exact
        simulation.reset()
        begin = time.perf_counter()
        for frame in range(1, exact.frames + 1):
            simulation.advance(1)
            simulation.synchronize()
            needed = (time.perf_counter() - begin) * exact.frames / frame
            if frame > 1 and needed > self.most:
                raise PeerError(f"its answer would take {needed:.0f} s, over {self.most:g} s")
        position = simulation.read("position")
        error = judge.error(case.scene, position)
        note = f"of the way of its tip, {exact.frames} frames after it was let go, over {judge.law}; bound {case.bound:.2g}"
        with self.store.transaction():
            self.store.add_measure(self.summary.run, case.description, case.sources, DIFFERENCE, error, "", note)
            if peer_tip is not None:
                off = exact.error(case.scene, position)
                self.store.add_measure(
                    self.summary.run, case.description, case.sources, PEER_LAW_DIFFERENCE, off, "", peer_tip.law
                )
        simulation.reset()
        if error <= case.bound:
            return None
        warning = f"wrong answer: {error:.2g} off ({note})".replace("; ", ", ")
        self.summary.wrong.append((str(case), warning))
        return warning

    def _expect(self, scene: Scene, steps: int) -> tuple[State, np.ndarray]:
        """Return (a displaced start, the positions after `steps` steps) by the lab's CPU; computed once per size."""
        key = scene.canonical()
        if self._expected is None or self._expected[0] != key:
            with open_simulation(scene, "cpu", precision="float64", math="exact") as judge:
                alone = scene.bodies or scene.tetrahedra  # bodies start apart from each other, or sag with time
                start = judge.state() if alone else displaced(judge)
                judge.load(start)
                judge.advance(steps)
                self._expected = (key, start, judge.state().position)
        return self._expected[1:]


def distances(position: np.ndarray, expected: np.ndarray, body: Body, spacing: float) -> tuple[float, float]:
    """Return (root mean square, maximum) over the free masses, in spacings; infinite if a value is not finite."""
    free = body.inverse_mass > 0
    if not free.any():
        return 0.0, 0.0
    offset = np.subtract(position, expected, dtype=np.float64)[free]
    squared = np.einsum("ij,ij->i", offset, offset)
    error, largest = math.sqrt(squared.mean()) / spacing, math.sqrt(squared.max()) / spacing
    return (error, largest) if math.isfinite(error) else (math.inf, math.inf)
