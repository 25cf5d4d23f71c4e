"""Bodies on a mesh that moves and turns, by CUDA kernels in plain Python: to the bits of the CPU."""

from __future__ import annotations

import pytest
from bodies_scenes import BAR, bodies_scene, end_state, method, same

HILLS = {
    "shape": {"name": "terrain", "resolution": 2}, "origin": [0.1, 0.05, -0.2], "angle": 10.0, "axis": [1.0, 0.0, 0.5],
    "velocity": [0.3, 0.5, 0.0], "spin": [0.2, 0.9, -0.3], "thickness": 0.08, "static_friction": 0.5,
    "dynamic_friction": 0.4,
}  # fmt: skip


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_bits_of_the_cpu(precision: str) -> None:
    scene = bodies_scene(
        bar=BAR | {"velocity": [1.0, -6.0, 0.5], "origin": [0.0, 0.4, 0.0]}, mesh_collider=HILLS, method=method(2, 1)
    )
    still = scene.replace({"mesh_collider.origin": [0.0, -50.0, 0.0]})
    host = end_state(scene, precision=precision)
    assert not same(host, end_state(still, precision=precision))  # it was met
    for kernel in ("launch", "stages"):
        assert same(host, end_state(scene, "gpu", precision=precision, kernel=kernel)), kernel
