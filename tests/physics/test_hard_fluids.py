"""Hard cases of fluids: every row keeps its law, or fails as its method implies; each law sees what it is about."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softlab.bench.experiments.accuracy.methods import FLUIDS
from softlab.bench.store.database import Store
from softlab.bench.stress import fluid_cases, fluids
from softlab.bench.stress.experiment import case_scene, judge_case, run_hard
from softlab.bench.stress.fluid_cases import FLUID_CASES, OUTRUN, SLOWED
from softlab.bench.stress.trial import Check, Trial
from softlab.model.core.simulation import State
from softlab.model.fluid.parameters import speed_limit

NAMES = {case.name: case for case in FLUID_CASES}
HOST: dict[str, Any] = {"threads": 1, "math": "exact"}
# the usual scheme in both precisions, which share the stages of the others but for what these two are there for
RUN = [
    ("pbf macklin", "float64"),
    ("pbf macklin", "float32"),
    ("pbf averaged", "float64"),
    ("pbf divergence-free", "float32"),
]
REASONS = {
    "F1 outrun": OUTRUN,
    "F5 slowed": SLOWED,
}


# rows that take seconds: the usual scheme in one precision, since divergence-free's stages are the same, in the other
DEAR = {"F1", "F4", "F6 drawn", "F10"}


@pytest.mark.parametrize(
    "name,method,precision",
    [(name, *run) for name in NAMES for run in RUN if not (name in DEAR and run == ("pbf macklin", "float32"))],
)
def test_the_laws_hold(name: str, method: str, precision: str) -> None:
    case = NAMES[name]
    outcome = judge_case(case, method, "cpu", precision, HOST)
    reason = case.known_failure(method, precision)
    if reason and not (name == "F3" and precision == "float32"):  # there rounding is as large
        assert outcome.verdict == "known" and outcome.diagnosis == reason == REASONS[name]
        return
    assert outcome.verdict == "pass" and not outcome.diagnosis, outcome.diagnosis
    assert any(check.relation for check in outcome.checks)
    assert outcome.end is not None and np.isfinite(outcome.end).all()


def test_every_method_is_run() -> None:
    assert {method for method, _ in RUN} == set(FLUIDS)


@pytest.mark.parametrize("method", FLUIDS)
def test_scenes_are_solved_as_the_method_says(method: str) -> None:
    for case in FLUID_CASES:
        scene, note = case_scene(case, method)
        assert scene.method.name == method and not note


def test_the_limit_is_half_a_support_a_substep() -> None:
    """What the reasons say, 10.9 m/s, and 37 substeps for 100 m/s."""
    scene = NAMES["F1"].base()
    (part,) = scene.fluids.values()
    assert speed_limit(scene, part) == pytest.approx(fluid_cases.FASTEST) == pytest.approx(10.909, abs=1e-3)
    for substeps, fast in ((37, True), (36, False)):
        assert (speed_limit(scene.replace({"method.substeps": substeps}), part) > 100) == fast


class MadeUp:
    """A simulation that reports as many lost neighbours as it is made with."""

    def __init__(self, lost: int):
        self.lost = lost

    def read(self, name: str) -> int:
        assert name == "neighbours_lost"
        return self.lost

    def __enter__(self) -> MadeUp:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class Moved(Trial):
    """Every state is the start, `changed` [m] along x and y, with a velocity `more` [m/s] than it had."""

    changed: tuple[float, float] = (0.0, 0.0)
    more = 0.0
    lost = 0

    def watch(self, looks: Any, initial: State | None = None, **how: Any) -> Any:
        begin = initial or self.start(self.scene.fluid_set.position, self.scene.fluid_set.velocity)
        for step in looks:
            position, velocity = begin.position.copy(), begin.velocity + self.more
            position[:, :2] += self.changed
            yield State(position, velocity, begin.inverse_mass, step * self.dt, step)

    def run(self, initial: State | None, seconds: float, *, allow_unstable: bool = False) -> State:
        return next(self.watch([self.steps(seconds)], initial))

    def open(self, *_: Any, **__: Any) -> Any:
        return MadeUp(self.lost)

    def advance(self, *_: Any) -> None:
        pass


@pytest.mark.parametrize(("name", "changed", "more", "seen"), [
    ("F1", (0.0, 0.0), 0.0, {fluids.OUTSIDE, fluids.LAG}),
    ("F2", (0.0, 0.0), 1.0, {fluids.FALL, fluids.HEIGHT, fluids.SPEED}),
    ("F2", (0.0, -5.1), 0.0, {fluids.FALL, fluids.BELOW}),
    ("F3", (0.0, 0.0), 20.0, {fluids.APART, fluids.LOST, fluids.FASTEST}),
    ("F3 alone", (0.0, 1e-6), 0.1, {fluids.SPEED, fluids.STIRRED}), ("F4", (0.0, 0.0), 0.0, {fluids.LOWER, fluids.HIGH}),
    ("F5", (0.0, -2.1), -200.0, {fluids.ENERGY, fluids.BELOW, fluids.FASTEST}),
    ("F5", (0.0, 0.0), 50.0, {fluids.ARRIVAL_SPEED}),
    ("F6", (0.01, 0.0), 0.0, {fluids.DRIFT, fluids.STIRRED}), ("F6 drawn", (0.01, 0.0), 0.0, {fluids.DRIFT}),
    ("F7", (0.0, 0.0), 1e-3, {fluids.LOST}), ("F8", (0.0, -1.0), 10.0, {fluids.THROUGH, fluids.FASTEST}),
    ("F9", (0.0, 0.0), 20.0, {fluids.REPORTED, fluids.MISSED, fluids.FASTEST}),
])  # fmt: skip
def test_laws_see_what_they_are_about(name: str, changed: tuple[float, float], more: float, seen: set[str]) -> None:
    scene, _ = case_scene(NAMES[name], FLUIDS[0])
    trial = Moved(scene)
    trial.changed, trial.more = changed, more
    assert seen <= {check.name for check in NAMES[name].law(trial) if not check.good}


def test_one_neighbour_that_is_not_told_is_seen() -> None:
    scene, _ = case_scene(NAMES["F9"], FLUIDS[0])
    trial = Moved(scene)

    def told(lost: int) -> Check:
        trial.lost = lost
        return next(check for check in NAMES["F9"].law(trial) if check.name == fluids.REPORTED)

    right = round(told(0).value * 0 + 1 / (1 - told(1).value))
    assert right > 100 and told(right).good and not told(right - 1).good


def test_verdicts_go_into_the_store_and_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    from softlab.bench.stress.report import print_hard

    with Store(":memory:") as store:
        how: dict[str, Any] = {"cases": ["F2", "F3 alone"], "integrators": FLUIDS[:1], "precisions": ["float64"]}
        summary = run_hard(store, progress=False, pictures=False, backends=["cpu"], **how)
        assert [(row.case, row.verdict, row.integrator, row.kind) for row in summary.rows] == [
            (name, "pass", FLUIDS[0], "fluid") for name in how["cases"]
        ]
        assert run_hard(store, progress=False, pictures=False, backends=["cpu"], **how).stored == 2
    print_hard(Console(width=200), summary)
    told = capsys.readouterr().out
    assert "F3 alone" in told and "pbf macklin" in told and "2 passed" in told
