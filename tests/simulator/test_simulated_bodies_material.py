"""Clusters that stretch, creep and are damped, in plain Python: to the bits of the CPU, stage by stage and step by step."""

from __future__ import annotations

import numpy as np
from bodies_scenes import end_state, of_all_materials, opened, same


def test_states_deformations_and_a_new_dt() -> None:
    scene = of_all_materials()
    half = end_state(scene, "gpu", steps=2)
    with opened(scene, "gpu", initial=half) as device, opened(scene, initial=half) as host:
        for simulation in (device, host):
            simulation.advance(1)
            simulation.rewind()
            simulation.set("method.dt", 0.02)
            simulation.advance(2)
        assert same(device.state(), host.state())
        for name in ("rotation", "centre", "deformation", "plastic"):
            assert np.array_equal(device.read(name), host.read(name)), name
        assert np.array_equal(device.state().plastic, host.state().plastic)  # reading makes nothing creep
