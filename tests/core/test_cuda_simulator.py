"""Runs tests/simulator in a process of its own, under numba's CUDA simulator."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "tests" / "simulator").rglob("test_*.py"))
SHARES = 2  # processes, so that several workers have something to do


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason='needs numba-cuda: pip install -e ".[test]"')
@pytest.mark.parametrize("share", range(SHARES))
def test_kernels_under_the_cuda_simulator(share: int, request: pytest.FixtureRequest) -> None:
    thorough = [name for name in ("--thorough", "--rest") if request.config.getoption(name)]
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    result = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *thorough]
        + [str(file) for file in FILES[share::SHARES]],
        env=own | {"NUMBA_ENABLE_CUDASIM": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=1200,
    )
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-2000:]
    assert " passed" in result.stdout
