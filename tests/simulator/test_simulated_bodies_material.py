"""Clusters that stretch, creep and are damped, in plain Python: to the bits of the CPU, stage by stage and step by step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bodies_scenes import end_state, of_all_materials, opened, same


@pytest.mark.parametrize(
    "leave_out,precision",
    [
        ((), "float32"),
        (("cluster_damping",), "float64"),
        (("linear", "cluster_damping"), "float32"),
        (("linear",), "float64"),
        ((), "float64"),
        (("plastic_threshold", "plastic_creep", "plastic_limit"), "float32"),
    ],
)
def test_the_bits_of_the_cpu(leave_out: Any, precision: str) -> None:
    scene = of_all_materials(leave_out)
    host = end_state(scene, poked=True, precision=precision, steps=3)
    if "plastic_creep" not in leave_out:
        assert np.abs(host.plastic - np.eye(3)).max() > 0.01
    for kernel in ("launch", "stages") if not leave_out else ("launch",):  # whose stages are the same
        device = end_state(scene, "gpu", poked=True, precision=precision, kernel=kernel, steps=3)
        assert same(host, device) and np.array_equal(host.plastic, device.plastic), kernel


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
