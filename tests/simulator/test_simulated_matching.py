"""Shape matching's CUDA kernels in plain Python: to the bits of the CPU, stage by stage and pass by pass."""

from __future__ import annotations

import numpy as np
import pytest
from test_matching import STEPS, end_state, everything, jelly

from softlab.model.base.errors import SceneError


@pytest.mark.parametrize("region,substeps,iterations", [(1, 1, 1), (2, 1, 2), (1, 2, 3)])
def test_the_bits_of_the_cpu(region: int, substeps: int, iterations: int) -> None:
    scene = everything(region, substeps, iterations)
    host = end_state(scene, poked=True)
    for kernel in ("launch", "stages"):
        device = end_state(scene, "gpu", poked=True, kernel=kernel)
        assert np.array_equal(host.position, device.position), kernel
        assert np.array_equal(host.velocity, device.velocity), kernel
    assert host.step == STEPS


def test_a_window_larger_than_the_grid() -> None:
    scene = jelly(2, 3, method__region=3, grid__pinned="none", perturbation__amplitude=0.1)
    assert np.array_equal(end_state(scene).position, end_state(scene, "gpu", kernel="launch").position)


@pytest.mark.parametrize("kernel", ["tiled", "one-block"])
def test_kernels_of_springs_only_are_refused(kernel: str) -> None:
    with pytest.raises(SceneError, match="shape-matching use graph"):
        end_state(jelly(), "gpu", kernel=kernel)
