"""The CUDA kernels of lattices in plain Python: to the bits of the CPU, stage by stage and step by step."""

from __future__ import annotations

import numpy as np
import pytest
from bodies_scenes import block, blocks, bodies_scene, end_state, method, opened, same


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("kernel", ["launch", "stages"])
def test_friction_turns_windows(precision: str, kernel: str) -> None:
    """Two lattices hit each other aside: their windows gather the couples of friction and turn, to the bits of the CPU."""
    coming = {"origin": [0.06, 0.29, 0.02], "velocity": [0.5, -4.0, 0.0]}
    one, other = block((2, 3, 1), 1, cluster_stiffness=4000.0), block((2, 3, 1), 1, cluster_stiffness=4000.0, **coming)
    contact = {"static_friction": 0.5, "dynamic_friction": 0.5}
    scene = bodies_scene(one=one, other=other, contact=contact, gravity=0.0, method=method(2, 1))
    host = end_state(scene, precision=precision, steps=2)
    assert same(host, end_state(scene, "gpu", precision=precision, kernel=kernel, steps=2))
    smooth = scene.replace({"contact.static_friction": 0.0, "contact.dynamic_friction": 0.0})
    assert np.abs(host.velocity[:, 0] - end_state(smooth, precision=precision, steps=2).velocity[:, 0]).max() > 0.01


def test_windows_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """How many windows a thread goes through changes no bit: one each, two, all of a group."""
    import softlab.gpu_backend.shape_matching.lattice as lattice

    scene, found = blocks(1, 1, (2, 6, 7), 1), []
    for busy in (2**17, 40, 1):
        monkeypatch.setattr(lattice, "BUSY", busy)
        found.append(end_state(scene, "gpu", precision="float32", steps=1, kernel="launch"))
    assert same(found[0], found[1]) and same(found[0], found[2])


def test_reading_rewinding_and_a_new_step() -> None:
    scene = blocks(1, 1, (3, 2, 2), 1)
    half = end_state(scene, "gpu", steps=1)
    with opened(scene, "gpu", initial=half) as device, opened(scene, initial=half) as host:
        for simulation in (device, host):
            simulation.advance(1)
            simulation.rewind()
            simulation.set("method.dt", 0.02)
            simulation.advance(1)
        assert same(device.state(), host.state())
        for name in ("rotation", "centre", "deformation"):
            assert np.array_equal(device.read(name), host.read(name)), name
