"""The CUDA kernel in which bodies meet a mesh compiles without a GPU where the compiler is there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_bodies_ptx import PARTS

pytestmark = pytest.mark.usefixtures("ptx_compiler")
MESH = PARTS - {"plane"} | {"mesh_collider"}


def ptx(real: Any, math: str) -> str:
    from numba import cuda, types

    from gpu_backend.xpbd_stages import make_xpbd_stages

    numbers = (types.float32 if real is np.float32 else types.float64)[::1]
    arguments = (numbers,) * 5 + (types.uint64[::1], types.int64)
    collide = make_xpbd_stages(real, math, MESH, 3).collide
    text, _ = cuda.compile_ptx(collide.py_func, arguments, cc=(9, 0), fastmath=math == "fast")
    return text[text.index(".entry") :]


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_and_no_local_memory(math: str) -> None:
    """The walk needs no stack: nothing lies in local memory, and all of it is one function."""
    text = ptx(np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


def test_exact_math_contracts_nothing() -> None:
    text = ptx(np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
