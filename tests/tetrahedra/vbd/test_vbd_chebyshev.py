"""Chebyshev's acceleration of vertex block descent: where it ends, how much sooner, the same bits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from vbd_scenes import BODY, end_state, moving, step_slope, vbd_scene

from softlab.model.formulas.elastic.chebyshev import weights

RHO = 0.9
LONG: dict[str, Any] = BODY | {"shape": {"name": "box", "sides": [0.6, 0.1, 0.1]}, "young_modulus": 2e5}


def test_weights_are_the_published_ones() -> None:
    """Eq. 12: after two sweeps that count fully 2 / (2 - rho^2), then towards 2 / (1 + sqrt(1 - rho^2))."""
    found = weights(RHO, 60, np.float64)
    assert found[:2].tolist() == [1.0, 1.0] and found[2] == pytest.approx(2 / (2 - RHO**2))
    assert found[3] == pytest.approx(4 / (4 - RHO**2 * found[2]))
    assert found[-1] == pytest.approx(2 / (1 + np.sqrt(1 - RHO**2)), rel=1e-9)
    assert len(weights(RHO, 1, np.float32)) == 1


def test_it_ends_where_sweeps_do() -> None:
    """The derivative of what a step makes least falls to rounding, too."""
    scene = vbd_scene(BODY, iterations=80).replace({"method.chebyshev": 0.7})
    begin = moving(scene)
    slope = step_slope(scene, begin)
    scale = np.abs(slope(begin.position + scene.method.dt * begin.velocity)).max()
    assert np.abs(slope(end_state(scene, start=begin).position)).max() < 1e-9 * scale


def test_a_stiff_bar_is_nearer_after_as_many_sweeps() -> None:
    """One step from out of shape: of the way that 15 sweeps leave, less than half."""
    scene = vbd_scene(LONG, iterations=15)
    begin = moving(scene)
    ends = {
        rho: end_state(scene.replace({"method.chebyshev": rho}), start=begin).position for rho in (0.0, RHO)
    }  # fmt: skip
    least = end_state(scene.replace({"method.iterations": 400}), start=begin).position
    left = {rho: float(np.linalg.norm(end - least)) for rho, end in ends.items()}
    assert left[RHO] < 0.5 * left[0.0]
