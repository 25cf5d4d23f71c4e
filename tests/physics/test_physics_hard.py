"""The hard cases of bench/stress/cases.py keep their laws: the hand-out's step and velocity Verlet, in float64, and in
float32 those that are about it. The other integrators are judged by `softlab hard`.

B8 and B9 are also taken apart in test_physics_diverged.py and test_stability_limits.py, B24 in test_cpu_reference.py.
"""

import numpy as np
import pytest
from hard_rules import judged_anew

from softlab.bench.stress.case import HardCase
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.experiment import Outcome, case_scene, judge_case
from softlab.bench.stress.laws import hanging
from softlab.model.scene.scene import load_scene

LIVE = ("damping", "gravity")  # as in the other tests of physics, so that they share machine code
NAMES = [case.name for case in CASES]
FORCED = [case for case in CASES if {"lab", "velocity-verlet"} <= set(case.methods)]
SINGLE = [case for case in CASES if case.row in ("B4", "B14", "B15")] + [CASES[NAMES.index("B6")]]


def judged(case: HardCase, name: str, backend: str, precision: str) -> Outcome:
    host = {"threads": 1, "kernel": "fused"} if backend == "cpu" else {}
    return judge_case(case, name, backend, precision, {"math": "exact", "live": LIVE, "timed": False, **host})


def expected(case: HardCase, name: str) -> str:
    """B14 is beyond the hand-out's velocity, a difference of rounded positions, in either precision."""
    return "known" if case.row == "B14" and name == "lab" else case.expect


def case_of(name: str) -> HardCase:
    return CASES[NAMES.index(name)]


@pytest.mark.parametrize("name", ["lab", "velocity-verlet"])
@pytest.mark.parametrize("case", FORCED, ids=[case.name for case in FORCED])
def test_hard_case(backend, case, name):
    """Passes, or is refused or fails where that is right, by the lab's own judge and by another one (hard_rules.py); every
    number beside its bound is in the failure's text."""
    outcome = judged(case, name, backend, "float64")
    assert outcome.verdict == expected(case, name), f"{outcome.diagnosis}; {', '.join(map(str, outcome.checks))}"
    assert outcome.end is None or np.isfinite(outcome.end).all()
    judged_anew(case.name, case_scene(case, name)[0], outcome.verdict, outcome.checks, outcome.end)


@pytest.mark.parametrize("name", ["lab", "velocity-verlet"])
@pytest.mark.parametrize("case", SINGLE, ids=[case.name for case in SINGLE])
def test_hard_case_in_float32(backend, case, name):
    """What is about float32 holds there."""
    outcome = judged(case, name, backend, "float32")
    assert outcome.verdict == expected(case, name), f"{outcome.diagnosis}; {', '.join(map(str, outcome.checks))}"


def test_a_refusal_names_the_step_size_that_holds(backend):
    """B8: the diagnosis is the door's own, with the limit of 1/32 s."""
    outcome = judged(case_of("B8"), "lab", backend, "float64")
    assert "0.03125" in outcome.diagnosis
    assert 1 <= outcome.checks[0].value <= 200


@pytest.mark.parametrize("name", ["lab", "velocity-verlet"])
def test_exact_symmetry_keeps_the_line_folded(backend, name):
    """B5: undisturbed, every column stays a straight fold at rest. A link that points up carries the same weight as one
    that points down, so the bottom row is a whole multiple of two rest lengths above the hanging grid's."""
    outcome = judged(case_of("B5 line"), name, backend, "float64")
    told = {check.name: check.value for check in outcome.checks}
    folds = told["distance from the hanging grid"] / 2
    assert round(folds) >= 1
    assert folds == pytest.approx(round(folds), abs=1e-9)
    assert told["residual force"] < 1e-9


@pytest.mark.parametrize(
    ("name", "published"), [("B10 100", 69.7 * 2**0.5), ("B10 1000", 985.0), ("B10 drag", 12950 * 2**0.5)]
)
def test_published_speeds_of_violent_pokes(backend, name, published):
    """B10 under `lab`, to the digits told; the first and last are components of motions along the diagonal."""
    told = {check.name: check.value for check in judged(case_of(name), "lab", backend, "float64").checks}
    assert told["largest speed"] == pytest.approx(published, rel=1e-3)


def test_the_published_hanging_grid():
    """A4: nine links, bottom row at y = -9.44145."""
    assert hanging(load_scene("hard/b5"))[-1, :, 1] == pytest.approx(-9.44145, abs=1e-9)
