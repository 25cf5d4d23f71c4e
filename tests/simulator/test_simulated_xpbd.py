"""The position-based solvers' CUDA kernels, in plain Python: stage by stage, pass by pass, on tiles and in one block to the
same bits, and to the independent NumPy reference within rounding."""

from __future__ import annotations

import numpy as np
import pytest
from xpbd_scenes import xpbd_scene

from softlab.app.driver import open_simulation
from softlab.model.core.simulation import State


def same(one: State, other: State) -> bool:
    return np.array_equal(one.position, other.position) and np.array_equal(one.velocity, other.velocity)


@pytest.mark.parametrize("kernel", ["stages", "one-block", "tiled:4x4x32d1"])
def test_live_changes_and_a_rewind(kernel: str) -> None:
    scene = xpbd_scene("air", "jacobi", rows=4, columns=4, pinned="top")
    with open_simulation(scene, "gpu", math="exact", kernel=kernel, live=("gravity",)) as simulation:
        simulation.advance(1)
        before = simulation.state()
        simulation.set("gravity.enabled", False)
        simulation.advance(1)
        still = simulation.state()
        simulation.load(before)
        simulation.set("gravity.enabled", True)
        simulation.advance(1)
        falling = simulation.state()
        simulation.rewind()
        simulation.load(before)
        simulation.advance(1)
        assert same(simulation.state(), falling)
    change = (falling.velocity - still.velocity).reshape(4, 4, 3)
    assert change[3, 1, 1] < 0 and falling.velocity[:4].max() == 0


def test_what_is_read_is_the_state() -> None:
    with open_simulation(xpbd_scene("grid", "jacobi"), "gpu", math="exact") as simulation:
        simulation.advance(1)
        assert simulation.kernel == "launch"
        assert np.array_equal(simulation.read("position"), simulation.state().position)
        assert simulation.read("velocity").shape == (30, 2)
    with open_simulation(xpbd_scene("springs", "jacobi"), "gpu", math="exact", precision="float64") as simulation:
        normal = simulation.read("normal")
        assert normal.shape == (42, 3) and np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-15
