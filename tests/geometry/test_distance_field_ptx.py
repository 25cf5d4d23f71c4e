"""The CUDA kernel in which bodies meet a distance field compiles without a GPU where the compiler is there."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import collide_text
from test_bodies_ptx import PARTS

pytestmark = pytest.mark.usefixtures("ptx_compiler")
FIELD = PARTS - {"plane"} | {"distance_field"}


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_and_no_local_memory(math: str) -> None:
    for parts in (FIELD, FIELD | {"restitution"}):
        text = collide_text(np.float32, math, parts)
        assert ".f64" not in text
        assert ".local" not in text and "call" not in text


def test_exact_math_contracts_nothing() -> None:
    text = collide_text(np.float64, "exact", FIELD)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
