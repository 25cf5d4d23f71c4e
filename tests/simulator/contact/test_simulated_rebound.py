"""Rigid bodies that come off colliders as a whole, by CUDA kernels in plain Python: to the bits of the CPU."""

from __future__ import annotations

from functools import cache

import pytest
from bodies_scenes import end_state, same
from rebound_scenes import among_soft_ones, dropped

from softlab.model.core.state import State


@pytest.mark.parametrize("precision,kernel", [("float32", "launch"), ("float64", "stages")])
def test_a_brick_on_its_corner(precision: str, kernel: str) -> None:
    scene = dropped(0.8, angle=40.0, height=0.4, speed=4.0, static_friction=0.3, dynamic_friction=0.2)
    host = end_state(scene, precision=precision, kernel="stages", steps=6)
    assert host.velocity[:, 1].mean() > -2.0
    assert same(host, end_state(scene, "gpu", precision=precision, kernel=kernel, steps=6))


@cache
def among_soft_ones_on_the_cpu() -> State:
    return end_state(among_soft_ones(), precision="float32", kernel="stages", steps=4)


@pytest.mark.parametrize("kernel", ["launch", "stages"])
def test_among_soft_bodies_and_contacts(kernel: str) -> None:
    assert same(
        among_soft_ones_on_the_cpu(), end_state(among_soft_ones(), "gpu", precision="float32", kernel=kernel, steps=4)
    )
