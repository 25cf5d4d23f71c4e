"""Implicit tetrahedral bodies on a real GPU in `fast` math: modes, sag, steps as far as in exact math."""

from __future__ import annotations

import numpy as np
import pytest
from newton_scenes import bar, end_state, shaken

from softlab.app.driver import open_simulation
from softlab.bench.experiments.tetrahedra import drop, let_go
from softlab.bench.experiments.tetrahedral.cantilever import SECOND, cantilever, exact_drop

pytestmark = pytest.mark.gpu
SETTLED = 300  # frames until a braked bar stands still


@pytest.mark.parametrize("across", [2, 4, 8])
def test_a_bar_comes_within_a_hundredth_at_second_order(across: int) -> None:
    """float32, fast math, one substep a frame: half a vibration after it was let go, by the modes of its mesh."""
    with open_simulation(let_go(cantilever(across, 1e7, SECOND, 1, 1)), "gpu") as simulation:
        moved = drop(simulation, across, 1e7)
    assert moved == pytest.approx(exact_drop(across, 1e7)[1], rel=0.01)


@pytest.mark.parametrize("across", [2, 4, 8])
def test_fast_math_steps_as_far(across: int) -> None:
    """float64, one substep of one Newton step: both solve the same system until 1e-4 of the first residual is left, in the
    preconditioner's norm, which for modes that this sees to alike is that part of the way."""
    start = shaken(bar(across)).position
    one, other = (end_state(bar(across), "gpu", 1, precision="float64", math=math) for math in ("exact", "fast"))
    moved = np.abs(one[0].position - start).max()
    np.testing.assert_allclose(other[0].position, one[0].position, atol=1e-3 * moved)


@pytest.mark.parametrize("across", [2, 4, 8])
def test_a_bar_in_float32_falls_from_its_rest_in_fast_math(across: int) -> None:
    """There nothing is strained but by rounding, and axes of strains are turned by ratios of roundings. Each of three steps
    is solved until 1e-4 of the first residual is left, which is 1e-3 of its way, as above."""
    scene, ends = let_go(cantilever(across, 1e7, "newton", 1, 1)), []
    for math in ("exact", "fast"):
        with open_simulation(scene, "gpu", precision="float32", math=math) as simulation:
            start = simulation.state().position
            simulation.advance(3)
            ends.append(simulation.state().position)
    moved = np.abs(ends[0] - start).max()
    assert moved > 1e-3
    np.testing.assert_allclose(ends[1], ends[0], atol=3e-3 * moved)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_bar_sags_as_on_the_cpu(precision: str) -> None:
    """Where it stands still the gradient is nothing, whatever the order of sums and the math."""
    scene = bar(2, damping=0.3)
    ends = []
    for backend in ("cpu", "gpu"):
        with open_simulation(scene, backend, precision=precision) as simulation:
            simulation.advance(SETTLED)
            ends.append(simulation.read("position"))
    sag = np.ptp(ends[0][:, 1]) - 0.1
    assert sag > 0.05
    np.testing.assert_allclose(ends[1], ends[0], atol=(2e-3 if precision == "float32" else 1e-5) * sag)
