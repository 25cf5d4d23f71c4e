"""Bodies that bounce off all kinds of colliders, by CUDA kernels in plain Python: to the bits of the CPU."""

from __future__ import annotations

from bodies_scenes import BAR, bodies_scene, end_state, method, same
from test_simulated_mesh_collider import HILLS

GIVES = {"restitution": 0.7, "thickness": 0.05, "static_friction": 0.3, "dynamic_friction": 0.2}


def test_the_bits_of_the_cpu() -> None:
    """In float32, whose roundings tell most; of all kinds at once, a bar at 6 m/s from among them."""
    scene = bodies_scene(
        bar=BAR | {"velocity": [1.0, -6.0, 0.5], "origin": [0.0, 0.4, 0.0]}, method=method(2, 1),
        plane=GIVES | {"point": [0.0, 0.15, 0.0], "normal": [0.2, 1.0, 0.1]},
        sphere=GIVES | {"center": [-0.2, 0.1, 0.0], "radius": 0.2},
        capsule=GIVES | {"start": [0.2, 0.2, -0.2], "end": [0.4, 0.25, 0.2], "radius": 0.05},
        box=GIVES | {"center": [0.0, 0.1, 0.2], "half_size": [0.1, 0.1, 0.1]}, mesh_collider=HILLS | {"restitution": 0.4},
    )  # fmt: skip
    host = end_state(scene, precision="float32")
    for name in ("plane", "sphere", "capsule", "box", "mesh_collider"):
        without = scene.replace({f"{name}.restitution": 0.0})
        assert not same(host, end_state(without, precision="float32")), name  # something bounced off it
    for kernel in ("launch", "stages"):
        assert same(host, end_state(scene, "gpu", precision="float32", kernel=kernel)), kernel
