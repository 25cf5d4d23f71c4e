"""Hard cases of a few masses come to the same verdict under the simulator as on the CPU, with the same numbers."""

from __future__ import annotations

import pytest

from bench.hard import judge_case
from bench.hard_cases import CASES

TINY = [case for case in CASES if case.row in ("B4", "B24")]


@pytest.mark.parametrize("case", TINY, ids=[case.name for case in TINY])
def test_same_verdict_as_on_the_cpu(case) -> None:
    cpu, gpu = (judge_case(case, "lab", backend, "float64", math="exact") for backend in ("cpu", "gpu"))
    assert gpu.verdict == cpu.verdict == case.expect, gpu.diagnosis
    assert gpu.checks == cpu.checks
