"""The position-based solvers on a real GPU: the CPU's bits in `exact` math, for every ordering and kernel, and a bounded
`fast`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from xpbd_scenes import poke_of, xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene

pytestmark = pytest.mark.gpu
STEPS = 60
ORDERINGS = ("gauss-seidel", "jacobi", "averaged-jacobi")


def end_state(scene: Scene, backend: str, steps: int = STEPS, poke: bool = True, **options: Any) -> State:
    live = ("poke",) if poke else ()
    with open_simulation(scene, backend, live=live, allow_unstable=True, **options) as simulation:
        if poke:
            simulation.poke(*poke_of(scene))
        simulation.advance(steps // 3)
        simulation.advance(steps - steps // 3)
        return simulation.state()


def assert_same(state: State, expected: State, what: object) -> None:
    assert np.array_equal(state.position, expected.position), what
    assert np.array_equal(state.velocity, expected.velocity), what


def test_tiles_and_colours_agree_on_a_large_sheet() -> None:
    """More tiles than the GPU runs at once, so that an order between blocks would show."""
    scene = xpbd_scene("springs", rows=701, columns=650)
    expected = end_state(scene, "gpu", steps=6, math="exact", kernel="graph")
    for kernel in (None, "tiled:16x16x384d1", "tiled:8x8x480d2"):
        assert_same(end_state(scene, "gpu", steps=6, math="exact", kernel=kernel), expected, kernel)
