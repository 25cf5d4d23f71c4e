"""Vertex block descent on a real GPU: the bits of the CPU's in exact math, its states in fast math."""

from __future__ import annotations

import numpy as np
import pytest
from test_vbd_contact import on_slope, pair, rest_of
from vbd_scenes import EVERYTHING, end_state

from softlab.model.scene.scene import Scene, load_scene

pytestmark = pytest.mark.gpu


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_bits_are_the_cpus(precision: str) -> None:
    scene = Scene(EVERYTHING)
    expected = end_state(scene, 20, precision=precision)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, 20, backend="gpu", precision=precision, kernel=kernel, threads=None)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("name", ["pair", "slope", "accelerated"])
def test_bits_of_what_meets(name: str, precision: str) -> None:
    scene = on_slope(20.0)[0] if name == "slope" else pair()
    if name == "accelerated":
        scene = scene.replace({"method.chebyshev": 0.8})
    expected = end_state(scene, 20, rest_of(scene), precision=precision)
    for kernel in ("graph", "launch", "stages"):
        state = end_state(scene, 20, rest_of(scene), backend="gpu", precision=precision, kernel=kernel, threads=None)
        assert np.array_equal(state.position, expected.position), kernel
        assert np.array_equal(state.velocity, expected.velocity), kernel


def test_fast_math_rounds_otherwise_alone() -> None:
    scene = Scene(EVERYTHING)
    one, other = (end_state(scene, 2, backend=b, math="fast", threads=t) for b, t in (("cpu", 1), ("gpu", None)))
    np.testing.assert_allclose(other.position, one.position, atol=1e-10)


def test_a_catalogue_scene_bends_alike() -> None:
    """In exact math, float32: the same bits after a second."""
    fields = {"method.solver": "vbd", "method.substeps": 1, "method.iterations": 10}
    scene = load_scene("fem-cantilever").replace(fields)
    both = [
        end_state(scene, 60, backend=b, precision="float32", threads=t) for b, t in (("cpu", 1), ("gpu", None))
    ]  # fmt: skip
    assert np.array_equal(both[0].position, both[1].position)
