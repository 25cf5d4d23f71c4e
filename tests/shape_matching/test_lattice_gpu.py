"""Lattices on a real GPU: the CPU's bits in exact math, fast math near to it, a state that goes on."""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import block, blocks, bodies_scene, end_state, method, opened, same

pytestmark = pytest.mark.gpu


def test_with_contacts() -> None:
    scene = bodies_scene(
        body=block((4, 4, 4), 1, copies=(2, 2, 1), apart=(0.3, 0.41, 0.0), spare=1, origin=[0.0, 0.2, 0.0]),
        plane={"point": [0.0, 0.0, 0.0], "thickness": 0.05}, contact={}, method=method(2, 1, 1 / 60),
    )  # fmt: skip
    for precision in ("float32", "float64"):
        expected = end_state(scene, precision=precision, steps=60, threads=4)
        assert same(end_state(scene, "gpu", precision=precision, steps=60), expected), precision


def test_reading_rewinding_and_a_new_step() -> None:
    scene = blocks()
    half = end_state(scene, "gpu", steps=2)
    with opened(scene, "gpu", initial=half) as device, opened(scene, initial=half) as host:
        for simulation in (device, host):
            simulation.advance(1)
            simulation.rewind()
            simulation.set("method.dt", 0.02)
            simulation.advance(2)
        assert same(device.state(), host.state())
        for name in ("rotation", "centre", "deformation"):
            assert np.array_equal(device.read(name), host.read(name)), name


def test_fast_math_is_near_exact() -> None:
    """As the test of bodies: 10 substeps, of places of 4 m."""
    fast, exact = (end_state(blocks(), "gpu", precision="float32", math=math) for math in ("fast", "exact"))
    np.testing.assert_allclose(fast.position, exact.position, atol=100 * 30 * 4 * 2.0**-22)
