"""Shape matching's CUDA kernels compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

import numpy as np
import pytest
from test_xpbd_mesh_ptx import ptx

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("kernel,arguments", [("match", "RRWWii"), ("move", "RRRWWPii")])
def test_float32_has_no_doubles(kernel: str, arguments: str, math: str) -> None:
    from softlab.gpu_backend.shape_matching.matching import make_matching

    text = ptx(getattr(make_matching(np.float32, math, 1), kernel), np.float32, math, arguments)
    assert ".f64" not in text and ".local" not in text
    if math == "exact":
        assert "fma" not in text
