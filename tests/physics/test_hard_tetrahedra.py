"""Hard cases of tetrahedra: every row keeps its law by every solver, and each law sees what it is about."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest

from softlab.bench.experiments.accuracy.methods import TETRAHEDRAL
from softlab.bench.store.database import Store
from softlab.bench.stress.experiment import case_scene, judge_case, run_hard
from softlab.bench.stress.results import HardRow, StoredCheck
from softlab.bench.stress.tetrahedra import MOMENTUM, RATIO, SPIN, STORED, STRETCH, VOLUME, spin_fraction
from softlab.bench.stress.tetrahedral_cases import SWEPT, TETRAHEDRAL_CASES
from softlab.bench.stress.trial import Trial
from softlab.labbook.claims import hard_tetrahedra
from softlab.model.base.errors import BackendUnavailable
from softlab.model.core.simulation import State
from softlab.plots.core.read import load

NAMES = {case.name: case for case in TETRAHEDRAL_CASES}
HOST: dict[str, Any] = {"threads": 1, "math": "exact"}


# nu 0.499, which takes seconds: each method in both precisions, on one of two scenes; voxels' constraints in the coarser one
ONE_OF_TWO = {"B22": ["float64"], "B22 bar": ["float32"], "B22 voxels": ["float32"]}


@pytest.mark.parametrize(
    "name,method,precision",
    [
        (case.name, method, precision)
        for case in NAMES.values()
        for method in case.methods
        for precision in ONE_OF_TWO.get(case.name, ["float64", "float32"])
    ],
)
def test_the_laws_hold(name: str, method: str, precision: str) -> None:
    case = NAMES[name]
    outcome = judge_case(case, method, "cpu", precision, HOST)
    if case.known_failure(method, precision):
        assert outcome.verdict == "known" and outcome.diagnosis == SWEPT
        assert 1e-5 < outcome.checks[0].value < 1e-3  # the momentum, after a second of 20 sweeps a substep
        return
    assert outcome.verdict == "pass" and not outcome.diagnosis, outcome.diagnosis
    assert outcome.checks[0].relation and outcome.end is not None and np.isfinite(outcome.end).all()


@pytest.mark.parametrize("method", TETRAHEDRAL)
def test_scenes_are_solved_as_the_method_says(method: str) -> None:
    for case in (one for one in TETRAHEDRAL_CASES if method in one.methods):
        scene, note = case_scene(case, method)
        assert scene.method.solver == method.split()[0] and not note
        assert (scene.method.substeps * scene.method.iterations == 1) == (case.row == "B23")


def test_spin_follows_the_law_of_rigid_bodies() -> None:
    """omega(t) = omega_0 / sqrt(1 + 2 omega_0^2 h t), of small turns; of 2 pi rad/s at 1/60 s 0.656777 after 1 s."""
    assert spin_fraction(2 * pi / 60, 60) == pytest.approx(0.656777, abs=2e-3)
    for h in (1e-3, 1e-4):
        assert spin_fraction(2 * pi * h, round(1 / h)) == pytest.approx(1 / sqrt(1 + 8 * pi**2 * h), rel=4 * h)


class Idle(Trial):
    """Nothing moves: the state stays the one that it began with, whatever the solver does."""

    def run(self, initial: State | None, seconds: float, *, allow_unstable: bool = False) -> State:
        found = self.scene.tetrahedra_set
        return initial or State(found.position, np.zeros_like(found.position), np.ones(found.particle_count), 0.0, 0)


class Growing(Trial):
    """It flies apart, a tenth more in each step."""

    def watch(self, looks: Any, initial: State | None = None, **how: Any) -> Any:
        assert initial is not None
        for step in looks:
            yield State(initial.position * 1.1**step, initial.velocity, initial.inverse_mass, 0.0, step)


@pytest.mark.parametrize(("name", "trial", "seen"), [
    ("B21 flat", Idle, {RATIO, STRETCH}), ("B21 inside out", Idle, {RATIO, STRETCH}), ("B21 random", Idle, {RATIO, STRETCH}),
    ("B22", Idle, {VOLUME}), ("A8 tumbling", Idle, {MOMENTUM, SPIN}), ("B23 bar", Growing, {STORED}),
])  # fmt: skip
def test_laws_see_what_they_are_about(name: str, trial: type[Trial], seen: set[str]) -> None:
    scene, _ = case_scene(NAMES[name], "newton")
    assert seen <= {check.name for check in NAMES[name].law(trial(scene)) if not check.good}


def test_a_solver_that_a_backend_has_not_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: Any, **__: Any) -> None:
        raise BackendUnavailable("no kernels", "run it elsewhere")

    monkeypatch.setattr("softlab.bench.stress.trial.open_simulation", missing)
    with Store(":memory:") as store:
        summary = run_hard(
            store, cases=["B23 bar"], integrators=["newton"], backends=["cpu"], progress=False, pictures=False
        )
        assert (summary.measured, summary.rows) == (0, [])


def test_claims_follow_the_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    def row(case: str, precision: str, verdict: str, **checks: float) -> HardRow:
        told = tuple(StoredCheck(NUMBERS[name], value, "", "") for name, value in checks.items())
        return HardRow(case, "vbd", "cpu", precision, 1 / 60, verdict, "", told)

    rows = [
        row("B21 flat", "float64", "pass", ratio=0.99, stretch=0.01),
        row("B21 random", "float32", "pass", ratio=0.9, stretch=0.05),
        row("B22", "float64", "pass", volume=0.05, ratio=0.1),
        row("B22 bar", "float64", "pass", volume=0.001, ratio=0.99),
        row("B23 bar", "float64", "pass", stored=0.8),
    ]
    monkeypatch.setattr(hard_tetrahedra, "_rows", lambda results: rows)
    claims = {name: claim(load(None)) for name, claim in hard_tetrahedra.CLAIMS.items()}
    assert all(claim.supported for claim in claims.values())
    assert claims["hard-tetrahedra"].numbers["pass"] == 5
    laws = claims["hard-tetrahedra-laws"]
    assert laws.numbers == {"ratio": 0.9, "stretch": 0.05, "volume": 0.05, "energy": 0.8}
    assert "has within 2 s every tetrahedron positively oriented again" in laws.sentence.replace(
        "\N{NO-BREAK SPACE}", " "
    )
    rows[0] = row("B21 flat", "float64", "fail", ratio=-0.1, stretch=0.01)
    broken = hard_tetrahedra.laws(load(None))
    assert not broken.supported and "not every tetrahedron" in broken.sentence


NUMBERS = {"ratio": RATIO, "stretch": STRETCH, "volume": VOLUME, "stored": STORED}
