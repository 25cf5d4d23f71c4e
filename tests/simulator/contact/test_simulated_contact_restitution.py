"""Particles that bounce off each other, by CUDA kernels in plain Python: to the bits of the CPU."""

from __future__ import annotations

from functools import cache

import pytest
from bodies_scenes import end_state, same
from meeting_bodies import meeting, smooth

from softlab.model.core.state import State
from softlab.model.scene.scene import Scene


def bars() -> Scene:
    """A bar whose clusters are damped, after its particles have bounced."""
    return meeting(1, 1, restitution=0.7).replace({"soft.cluster_damping": 4.0})


SCENES = {"meeting": meeting(2, 1, restitution=0.7), "damped": bars()}


@cache
def on_the_cpu(name: str) -> State:
    return end_state(SCENES[name], precision="float32", kernel="stages", steps=4)


@pytest.mark.parametrize(
    "name,kernel",
    [("meeting", "launch"), ("meeting", "stages"), ("damped", "launch")],
    ids=["launch", "stages", "damped"],
)
def test_the_bits_of_the_cpu(name: str, kernel: str) -> None:
    """In float32, whose roundings tell most."""
    scene, host = SCENES[name], on_the_cpu(name)
    assert same(host, end_state(scene, "gpu", precision="float32", kernel=kernel, steps=4))


def test_bodies_of_one_kind() -> None:
    scene = smooth(2, 1).replace({"contact.restitution": 1.0})
    host = end_state(scene, kernel="stages", steps=3)
    assert same(host, end_state(scene, "gpu", kernel="launch", steps=3))
