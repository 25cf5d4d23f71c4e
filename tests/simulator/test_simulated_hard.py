"""Hard cases of a few masses come to the same verdict under the simulator as on the CPU, with the same numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest

from softlab.bench.experiments.accuracy.methods import FLUIDS, MATCHING
from softlab.bench.stress import fluids
from softlab.bench.stress.bodies import is_stopped_by_a_box, is_whole_at_once
from softlab.bench.stress.cases import CASES
from softlab.bench.stress.experiment import judge_case
from softlab.bench.stress.rotations import finds_rotations, goals_are_exact

TINY = [case for case in CASES if case.row in ("B4", "B24")]
BODIES = {case.name: case for case in CASES if case.of_bodies}
OF_BODIES = {  # name -> law: of a few substeps
    "A10 rigid": is_whole_at_once,
    "B16 box": is_stopped_by_a_box,
    "B20": finds_rotations(1, ("mirrored", "on a line")),
    "B20 flat": goals_are_exact(1),
}


@pytest.mark.parametrize("case", TINY, ids=[case.name for case in TINY])
def test_same_verdict_as_on_the_cpu(case) -> None:
    cpu, gpu = (judge_case(case, "lab", backend, "float64", {"math": "exact"}) for backend in ("cpu", "gpu"))
    assert gpu.verdict == cpu.verdict == case.expect, gpu.diagnosis
    assert gpu.checks == cpu.checks


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", OF_BODIES)
def test_bodies_have_the_same_numbers_as_on_the_cpu(name: str, precision: str) -> None:
    case = replace(BODIES[name], law=OF_BODIES[name])
    cpu, gpu = (judge_case(case, MATCHING, backend, precision, {"math": "exact"}) for backend in ("cpu", "gpu"))
    assert gpu.verdict == cpu.verdict == "pass", gpu.diagnosis
    assert gpu.checks == cpu.checks


@pytest.mark.parametrize("method", FLUIDS)
def test_two_particles_in_one_place_have_the_same_numbers(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fluids, "SECONDS", 1 / 60)
    case = next(case for case in CASES if case.name == "F3 alone")
    cpu, gpu = (judge_case(case, method, backend, "float64", {"math": "exact"}) for backend in ("cpu", "gpu"))
    assert gpu.verdict == cpu.verdict == "pass", gpu.diagnosis
    assert gpu.checks == cpu.checks
