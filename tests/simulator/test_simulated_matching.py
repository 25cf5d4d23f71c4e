"""Shape matching's CUDA kernels in plain Python: to the bits of the CPU, stage by stage and pass by pass."""

from __future__ import annotations

import numpy as np
import pytest
from test_matching import end_state, jelly

from softlab.model.base.errors import SceneError


def test_a_window_larger_than_the_grid() -> None:
    scene = jelly(2, 3, method__region=3, grid__pinned="none", perturbation__amplitude=0.1)
    assert np.array_equal(end_state(scene).position, end_state(scene, "gpu", kernel="launch").position)


@pytest.mark.parametrize("kernel", ["tiled", "one-block"])
def test_kernels_of_springs_only_are_refused(kernel: str) -> None:
    with pytest.raises(SceneError, match="shape-matching use graph"):
        end_state(jelly(), "gpu", kernel=kernel)
