"""A solver family of its own, added by one entry and one class: particles that only fall. What docs/add-a-solver.md tells.

Nothing else of the lab knows it: the driver, live changes, divergence, energies, the limit and `softlab plan` follow from the
entry.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import pytest

from softlab.app.driver import open_simulation
from softlab.app.plan.passes import BackendPlan, merged_pass
from softlab.app.plan.report import plan_report
from softlab.model.base.errors import Diverged, SceneError
from softlab.model.core import families
from softlab.model.core.family import SolverFamily
from softlab.model.core.plan import Executor, Moment, Node, Plan, Stage
from softlab.model.core.simulation import Options, Simulation
from softlab.model.scene.scene import Scene, load_scene

DT, G = 0.01, 9.81
DOWN, STEP_SIZE = range(2)  # of its record


class Falling(Simulation):
    """Semi-implicit Euler in NumPy, a stage that kicks and one that drifts."""

    backend, device, kernel = "cpu", "any", "stages"

    def __init__(self, scene: Scene, options: Options, threads: str | int = 1):
        super().__init__(scene, options)
        self.threads, self.plan = 1, families.family_of(scene).plan(scene, options.live)
        self._position, self._velocity = (np.zeros(self.body.position.shape, self.real) for _ in range(2))
        self._executor = Executor(self.plan, {"kick": self._kick, "drift": self._drift})
        self.reset()

    def _kick(self, moment: Moment) -> None:
        self._velocity[:, 1] += self._record[DOWN] * self._record[STEP_SIZE]

    def _drift(self, moment: Moment) -> None:
        self._position += self._velocity * self._record[STEP_SIZE]

    def _run(self, steps: int) -> None:
        self._executor.run(self.step, steps)

    def _store_snapshot(self) -> None:
        self._kept = self._position.copy(), self._velocity.copy()

    def _restore(self) -> None:
        self._position[:], self._velocity[:] = self._kept

    def _first_diverged(self) -> int:
        bad = ~(np.abs(self._position) <= self._bound).all(axis=1)
        return int(np.argmax(bad)) if bad.any() else -1

    def _parameters_changed(self) -> None:
        """The record is read where it is."""

    def _download(self) -> tuple[np.ndarray, np.ndarray]:
        return self._position.copy(), self._velocity.copy()

    def _upload(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self._position[:], self._velocity[:] = position, velocity

    def synchronize(self) -> None:
        """Nothing to wait for."""


def plan(scene: Scene, live: frozenset[str]) -> Plan:
    return Plan(Node("step", (Stage("kick", 1, 1, 2), Stage("drift", 2, 1, 4))), 4, frozenset({"gravity"}))


def record(scene: Scene, real: Any, poke: tuple[float, ...], clock: Any) -> np.ndarray:
    down = -scene.gravity.acceleration if scene.gravity and scene.gravity.enabled else 0.0
    return np.array([down, scene.method.dt], real)


def passes(scene: Scene, precision: str, found: Plan) -> BackendPlan:
    item = 4 if precision == "float32" else 8
    moved = (merged_pass(list(found.root.stages()), item, found.dimensions, "in NumPy"),)
    return BackendPlan("cpu", "any", "stages", None, "there is no other", moved)


TOY = SolverFamily(
    name="falling particles",
    accepts=lambda scene: scene.springs is None,
    knows=frozenset({"grid", "gravity", "method"}),
    plan=plan,
    record=record,
    limit=lambda scene, frequency: inf,
    limited_by_net=False,
    note=lambda scene: "falls; first order",
    stored=lambda scene, position, arrays: (0.0, {}),
    strain=lambda scene, position, kind, arrays: np.zeros(0),
    spring_count=lambda scene: 0,
    solvers={"cpu": f"{__name__}:Falling"},
    passes={"cpu": f"{__name__}:passes"},
    reference="softlab.bench.reference.mass_spring",
    unknown="nobody has asked",
)


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    monkeypatch.setattr(families, "families", lambda: (TOY,))
    tables = load_scene("lab-grid").as_dict()
    kept = {name: table for name, table in tables.items() if name in ("grid", "gravity", "method")}
    return Scene(kept).replace({"grid.pinned": "none", "method.dt": DT, "gravity.acceleration": G})


def test_it_falls_as_semi_implicit_euler_does(scene: Scene) -> None:
    """y = -g dt^2 n (n + 1) / 2 and v = -g dt n after n steps; exact up to the roundings of so many additions."""
    with open_simulation(scene, precision="float64", live=("gravity", "dt")) as simulation:
        start, steps = simulation.state(), 100
        assert simulation.limit == inf and simulation.stages.keys() == {"kick", "drift"}
        simulation.advance(steps)
        state = simulation.state()
        fallen = start.position[:, 1] - state.position[:, 1]
        assert fallen == pytest.approx(G * DT**2 * steps * (steps + 1) / 2, rel=steps * 2.0**-50)
        assert -state.velocity[:, 1] == pytest.approx(G * DT * steps, rel=steps * 2.0**-50)
        lost = start.position[:, 1].sum() - state.position[:, 1].sum()
        found = simulation.energies()
        assert found["spring"] == 0 and found["gravity"] == pytest.approx(
            scene.grid.mass * G * (start.position[:, 1].sum() - lost), rel=1e-12
        )
        simulation.set("gravity.enabled", False)
        simulation.advance(steps)
        assert np.array_equal(simulation.state().velocity, state.velocity)
        simulation.load(start)
        assert np.array_equal(simulation.state().position, start.position)


def test_what_is_the_same_for_all_holds_for_it(scene: Scene) -> None:
    with pytest.raises(SceneError, match=r"^backend = "):
        open_simulation(scene, "tpu")
    with open_simulation(scene, live=("dt",)) as simulation:
        with pytest.raises(SceneError, match="not live"):
            simulation.set("gravity.enabled", False)
        simulation.set("method.dt", 1e4)
        with pytest.raises(Diverged) as found:
            simulation.advance(10_000)
            simulation.check()
        assert found.value.particle == 0


def test_the_plan_tells_of_it(scene: Scene) -> None:
    report = plan_report(scene, backends=("cpu",))
    assert [row.name for row in report.rows if row.stage] == ["kick", "drift"] and report.springs == 0
    assert report.backends[0].passes[0].stages == ("kick", "drift") and report.as_dict()["limit"] is None
