"""The CUDA kernels of bodies in plain Python: to the bits of the CPU, stage by stage and step by step."""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import by_hand, degenerate, end_state, everything, opened, same, start

from softlab.model.base.errors import SceneError


def test_clusters_without_a_volume() -> None:
    clusters = degenerate()
    scene, random = by_hand(clusters), np.random.default_rng(2)
    begin = start(scene, clusters.position + random.normal(0, 0.03, clusters.position.shape))
    assert same(end_state(scene, start=begin, steps=2), end_state(scene, "gpu", start=begin, steps=2, kernel="launch"))


def test_states_rotations_and_a_new_dt() -> None:
    scene = everything(1, 1)
    half = end_state(scene, "gpu", steps=2)
    with opened(scene, "gpu", initial=half) as device, opened(scene, initial=half) as host:
        for simulation in (device, host):
            simulation.advance(1)
            simulation.rewind()
            simulation.set("method.dt", 0.02)
            simulation.advance(2)
        assert same(device.state(), host.state())
        for name in ("rotation", "centre"):
            assert np.array_equal(device.read(name), host.read(name)), name
        assert same(device.state(), host.state())


def test_other_kernels_are_refused() -> None:
    with pytest.raises(SceneError, match="graph, launch, stages for bodies"):
        end_state(everything(), "gpu", kernel="resident")
