"""The CUDA kernel of implicit tetrahedral bodies, in plain Python, one block: the CPU's bits, and as many passes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from newton_scenes import end_state, groups_and_bodies, newton_scene
from tetrahedra_scenes import BODY

from softlab.model.core.simulation import State
from softlab.model.scene.scene import Scene


@cache
def groups_on_the_cpu() -> tuple[State, Any]:
    """Groups and bodies after a step, in float64 and exact math, and the passes it took."""
    return end_state(groups_and_bodies(), "cpu", 1, precision="float64", math="exact", threads=1)


def held_against_the_cpu(scene: Scene, precision: str, steps: int, **options: Any) -> State:
    expected, done = end_state(scene, "cpu", steps, precision=precision, math="exact", threads=1, **options)
    state, found = end_state(scene, "gpu", steps, precision=precision, math="exact", **options)
    assert found == done
    assert np.array_equal(state.position, expected.position)
    assert np.array_equal(state.velocity, expected.velocity)
    return state


def test_fast_math_takes_sums_in_another_order_alone() -> None:
    """As many passes; places to float64's rounding, 2e-16, times the condition of a system, below 1e6, times a metre."""
    scene = groups_and_bodies()
    expected, done = groups_on_the_cpu()
    state, found = end_state(scene, "gpu", 1, precision="float64", math="fast")
    assert found == done
    np.testing.assert_allclose(state.position, expected.position, atol=2e-10)
    np.testing.assert_allclose(state.velocity, expected.velocity, atol=2e-10 * 2 / scene.method.dt)


def test_bits_where_all_is_held() -> None:
    scene = newton_scene("fixed-corotated", body=BODY | {"pinned": ["bottom", "top"]})
    state = held_against_the_cpu(scene, "float64", 1, initial=None)
    assert not state.velocity.any()
