"""The CUDA kernel in which bodies meet colliders that give back compiles without a GPU where the compiler is there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_bodies_ptx import PARTS

from model.cloth_record import B_RESTITUTION

pytestmark = pytest.mark.usefixtures("ptx_compiler")
BOUNCES = PARTS | {"restitution"}


def ptx(real: Any, math: str, parts: frozenset[str]) -> str:
    from numba import cuda, types

    from gpu_backend.xpbd_stages import make_xpbd_stages

    numbers = (types.float32 if real is np.float32 else types.float64)[::1]
    arguments = (numbers,) * 5 + (types.uint64[::1], types.int64)
    collide = make_xpbd_stages(real, math, parts, 3).collide
    text, _ = cuda.compile_ptx(collide.py_func, arguments, cc=(9, 0), fastmath=math == "fast")
    return text[text.index(".entry") :]


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_and_no_local_memory(math: str) -> None:
    for parts in (BOUNCES, BOUNCES - {"plane"} | {"mesh_collider"}):
        text = ptx(np.float32, math, parts)
        assert ".f64" not in text
        assert ".local" not in text and "call" not in text


def test_exact_math_contracts_nothing() -> None:
    text = ptx(np.float64, "exact", BOUNCES)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text


def test_it_is_compiled_in_where_a_collider_gives_back() -> None:
    place = f"+{4 * B_RESTITUTION}]"
    assert place in ptx(np.float32, "fast", BOUNCES) and place not in ptx(np.float32, "fast", PARTS)
