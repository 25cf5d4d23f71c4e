"""Rotations compile for CUDA without a GPU where the compiler is there: no double in float32, no call, nothing contracted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of

from softlab.model.formulas import rotation

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(real: Any, math: str) -> str:
    """Of a kernel of one cluster: A (9,), q (4,) -> q, and a turn in two dimensions of the same numbers."""
    from numba import types

    from softlab.gpu_backend.core.formulas import device_formulas

    formulas = device_formulas(rotation, real, math)
    rotation_2d, rotation_3d, rotated = formulas.rotation_2d, formulas.rotation_3d, formulas.rotated

    def turn(A: Any, q: Any, v: Any) -> None:
        w, x, y, z = rotation_3d((A[0], A[1], A[2], A[3], A[4], A[5], A[6], A[7], A[8]), (q[0], q[1], q[2], q[3]))
        v[0], v[1], v[2] = rotated(w, x, y, z, v[0], v[1], v[2])
        v[3], v[4] = rotation_2d(A[0], A[1], A[3], A[4], v[3], v[4])
        q[0], q[1], q[2], q[3] = w, x, y, z

    numbers = (types.float32 if real is np.float32 else types.float64)[::1]
    return entry_of(turn, (numbers,) * 3, math)


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_holds_no_double_no_local_memory_and_no_call(math: str) -> None:
    text = ptx(np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text
    assert "sqrt.rn.f32" in text if math == "exact" else "sqrt.approx" in text


def test_exact_math_contracts_nothing() -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = ptx(np.float64, "exact")
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text and "sqrt.rn.f64" in text
