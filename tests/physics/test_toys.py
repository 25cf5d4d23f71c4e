"""A force, a constraint and an integrator are an entry each, in a file of its own, and both backends have them."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import toy_constraint
import toy_force
import toy_integrator

from softlab.model.base.errors import InputError
from softlab.model.core import own_forces
from softlab.model.scene.scene import Scene
from softlab.model.shape_matching.plan import body_parts

ROOT = Path(__file__).parents[2]
KERNELS = 4  # both backends, the kernel of their choice and stage by stage
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason='needs numba-cuda: pip install -e ".[test]"'
)


def results_of(toy: ModuleType, scenes: int) -> list[dict[str, Any]]:
    """Return what it prints of each run, in a process of its own, since solvers read registries when they are imported."""
    result = subprocess.run(
        [sys.executable, str(toy.__file__)],
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
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
    results: list[dict[str, Any]] = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(results) == KERNELS * scenes and all(run["same"] for run in results), results
    return results


def test_one_entry_and_every_solver_has_it() -> None:
    """Semi-implicit Euler of x'' = a from rest: x_n = a dt^2 n (n + 1) / 2, here sums of dyadic numbers, so to the bit."""
    far = toy_force.LEAN * toy_force.DT**2 * toy_force.STEPS * (toy_force.STEPS + 1) / 2
    for run in results_of(toy_force, len(toy_force.SCENES)):
        assert (run["least"], run["most"]) == pytest.approx((far, far), rel=1e-5) and run["aside"] <= 1e-6 * far, run


def test_a_force_that_changes_with_the_step_is_refused_by_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their kernels pass 0 as the number of the step."""
    changing = own_forces.OwnForce(
        "lean", "lean", lambda scene, live: True, toy_force.lean, ("lean",), toy_force.values, "lean", changes=True
    )
    monkeypatch.setattr(own_forces, "PARTICLE_FORCES", (*own_forces.PARTICLE_FORCES, changing))
    with pytest.raises(InputError, match="do not know the step: lean"):
        body_parts(Scene(toy_force.SCENES["body"]))


def test_a_constraint_limits_stretches_alone() -> None:
    """Of a sheet in one step: stretched, it shrinks to its limit; compressed, it stays."""
    for run in results_of(toy_constraint, 1):
        stretched, compressed = run["strains"]
        assert stretched == pytest.approx(toy_constraint.GROWTH, abs=1e-3), run
        assert compressed == pytest.approx(toy_constraint.COMPRESSED - 1, abs=1e-6), run


def test_an_integrator_falls_along_the_parabola() -> None:
    """x_n = a (n dt)^2 / 2 of x'' = a from rest, exactly; with springs, bits alone are compared."""
    far = toy_integrator.G * (toy_integrator.DT * toy_integrator.STEPS) ** 2 / 2
    for run in results_of(toy_integrator, 2):
        assert run["springs"] or run["fallen"] == pytest.approx(far, rel=1e-5), run
