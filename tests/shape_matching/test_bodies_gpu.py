"""Bodies on a real GPU: the CPU's bits in exact math, fast math near to it, states that go on."""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import by_hand, degenerate, end_state, everything, opened, same, start

from softlab.model.scene.scene import load_scene

pytestmark = pytest.mark.gpu


def test_jelly_drop_has_the_cpus_bits() -> None:
    scene = load_scene("jelly-drop")
    expected = end_state(scene, precision="float32", steps=60, threads=2)
    assert same(end_state(scene, "gpu", precision="float32", steps=60), expected)


def test_clusters_without_a_volume() -> None:
    clusters = degenerate()
    scene, random = by_hand(clusters), np.random.default_rng(2)
    begin = start(scene, clusters.position + random.normal(0, 0.03, clusters.position.shape))
    assert same(end_state(scene, start=begin), end_state(scene, "gpu", start=begin))


def test_fast_math_is_near_exact() -> None:
    """As on the CPU, and approximate roots and quotients of 2^-22: 10 substeps whose errors grow with the square of their
    number, of places of 2 m."""
    fast, exact = (end_state(everything(), "gpu", precision="float32", math=math) for math in ("fast", "exact"))
    np.testing.assert_allclose(fast.position, exact.position, atol=100 * 30 * 2 * 2.0**-22)


def test_states_change_hands_and_rotations_are_the_cpus() -> None:
    scene = everything()
    half, whole = end_state(scene, steps=4), end_state(scene, steps=8)
    with opened(scene, "gpu", initial=half) as device, opened(scene, initial=half) as host:
        for name in ("rotation", "centre"):
            assert np.array_equal(device.read(name), host.read(name)), name
        device.advance(4)
        assert same(device.state(), whole)
