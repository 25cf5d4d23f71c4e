"""The hard cases of position-based solvers: the judge's own columns, and the laws by runs on the CPU."""

from dataclasses import replace

import pytest

import softlab.bench.stress.experiment as hard
from softlab.bench.experiments.accuracy.methods import FLUIDS, MATCHING, METHODS, TETRAHEDRAL
from softlab.bench.store.results import Measure, configuration
from softlab.bench.stress.case import FORCES, POSITIONS, HardCase
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.report import table_of
from softlab.bench.stress.results import rows_of
from softlab.model.scene.scene import load_scene

MINE = [case for case in CASES if set(POSITIONS) <= set(case.methods)]
NAMED = {case.name: case for case in CASES}


def test_which_cases_are_theirs():
    """B1, B2, B3, B4, B8, B13, B23 and B24; of those that integrators refuse or cannot know there are cases of their own."""
    assert {case.row for case in MINE} == {"B1", "B2", "B3", "B4", "B8", "B13", "B23", "B24"}
    alone = {case.name for case in MINE if not set(case.methods) & set(FORCES)}
    assert alone == {"B1 implicit", "B2", "B3", "B8 implicit", "B13 inextensible", "B23"}
    assert all(set(case.methods) <= {*METHODS, MATCHING, *TETRAHEDRAL, *FLUIDS} for case in CASES)


@pytest.mark.parametrize("case", MINE, ids=[case.name for case in MINE])
def test_scenes_of_a_method(case):
    """Solved by the ordering asked for, at the scene's own dt, and with its substeps where it states them."""
    if case.name == "B24 empty":
        return
    own = load_scene(case.scene).method
    for name in POSITIONS:
        scene, note = hard.case_scene(case, name)
        assert (scene.method.name, scene.method.dt, note) == (name, own.dt, "")
        assert scene.method.substeps == (own.substeps if own.position_based else 1)
        assert scene.method.iterations == case.changes.get("method.iterations", 1)


def test_only_its_methods_are_run():
    work = hard._work(CASES, METHODS, ["cpu"], ["float64"])
    ran = {(w.case.name, w.method) for w in work}
    assert ("B2", "xpbd jacobi") in ran and ("B2", "rk4") not in ran
    assert ("B5 line", "rk4") in ran and ("B5 line", "xpbd jacobi") not in ran
    assert ("B4", "rk4") in ran and ("B4", "xpbd gauss-seidel") in ran
    assert not {method for _, method in ran} & {"xpbd averaged-jacobi"}


def test_columns_of_the_table():
    """Integrators first, then the orderings, whose names come from the method's table."""
    rows = []
    for name in (*POSITIONS[::-1], "lab"):
        scene, _ = hard.case_scene(NAMED["B4"], name)
        description = configuration(scene, backend="cpu") | {"hard": "B4"}
        rows.append(Measure("m", name, "s", "r", description, "hard_verdict", 1.0, "", ""))
    names, lines = table_of(rows_of(rows))
    assert names == ["lab", *POSITIONS]
    assert [cell for cell, _ in lines[0][3]] == ["pass"] * 3


# ---------------------------------------------------------------------- the laws


def run(name: str, method: str, **how):
    case = replace(NAMED[name], **how)
    outcome = hard.judge_case(case, method, "cpu", "float64", {"kernel": "stages"})
    assert outcome.verdict == "pass", outcome.diagnosis
    return {check.name: check.value for check in outcome.checks}


def seldom(case: HardCase, **changes: float) -> dict:
    """Changes of a case in which it is shorter."""
    return {"changes": {**case.changes, **changes}}


@pytest.mark.parametrize(
    ("method", "substeps", "iterations"), [(POSITIONS[0], 1.01, 97.6), (POSITIONS[1], 4.15, 184.0)]
)
def test_a_thousandfold_mass(method, substeps, iterations):
    """B2: what bench/reference/xpbd.py has, to three digits: iterations cannot do what substeps do."""
    checks = run("B2", method)
    assert checks["stretch"] == pytest.approx(substeps, rel=6e-3)
    assert checks["stretch with 100 iterations of one substep"] == pytest.approx(iterations, rel=6e-3)


@pytest.mark.parametrize("method", POSITIONS)
@pytest.mark.parametrize("name", ["B1 implicit", "B4", "B4 zero", "B8 implicit", "B23", "B24 column", "B24 pinned"])
def test_they_hold(name, method):
    run(name, method)


@pytest.mark.parametrize("method", POSITIONS)
def test_tethers_hold_a_long_chain(method):
    """B13, at 128 links; without the tethers one iteration lets it stretch."""
    short = seldom(NAMED["B13 inextensible"], **{"grid.rows": 129})
    run("B13 inextensible", method, **short)
    loose = {path: value for path, value in short["changes"].items() if not path.startswith("attachments")}
    outcome = hard.judge_case(
        replace(NAMED["B13 inextensible"], changes=loose), method, "cpu", "float64", {"kernel": "stages"}
    )
    assert outcome.verdict == "fail" and "farther from the pin" in outcome.diagnosis
