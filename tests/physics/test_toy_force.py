"""A force on each particle by itself is one entry of PARTICLE_FORCES, and every solver of both backends has it."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import toy_force

ROOT = Path(__file__).parents[2]
RUNS = 4 * len(toy_force.SCENES)  # both backends, the kernel of their choice and stage by stage


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason='needs numba-cuda: pip install -e ".[test]"')
def test_one_entry_and_every_solver_has_it() -> None:
    """Semi-implicit Euler of x'' = a from rest: x_n = a dt^2 n (n + 1) / 2, here sums of dyadic numbers, so to the bit; in a
    process of its own, since solvers read the registry when they are imported."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    result = subprocess.run(
        [sys.executable, toy_force.__file__],
        env=own
        | {
            "NUMBA_ENABLE_CUDASIM": "1",
            "SOFTLAB_PLAIN_PYTHON": "1",
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests" / "simulator")]),
        },
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert result.returncode == 0, result.stderr[-2000:]
    runs = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(runs) == RUNS
    far = toy_force.LEAN * toy_force.DT**2 * toy_force.STEPS * (toy_force.STEPS + 1) / 2
    for run in runs:
        assert (run["least"], run["most"]) == pytest.approx((far, far), rel=1e-5) and run["aside"] <= 1e-6 * far, run
        assert run["same"], run
