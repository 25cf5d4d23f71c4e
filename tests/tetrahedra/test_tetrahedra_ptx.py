"""The CUDA kernels of tetrahedra compile without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import record_of

from model.formulas.constraints.tetrahedron import MATERIALS
from model.tetrahedra.constraints import DAMPED, projections_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def text_of(material: str, real: Any, math: str, damped: bool = True) -> str:
    from numba import cuda, types

    from gpu_backend.core.constraints import make_projections

    (projection,) = projections_of(frozenset({material}) | ({DAMPED} if damped else frozenset()))
    reals, i, n = (types.float32 if real is np.float32 else types.float64)[::1], types.int32, types.int32[::1]
    kernel = make_projections(real, math, projection)
    record = record_of(real, "tetrahedra")
    text, _ = cuda.compile_ptx(
        kernel.py_func, (reals, reals, n, reals, reals, i, i, i, i, record), cc=(9, 0), fastmath=math == "fast"
    )
    return str(text[text.index(".entry") :])


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("material", MATERIALS)
def test_float32_projections_hold_no_double_and_no_local_memory(material: str, math: str) -> None:
    text = text_of(material, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text


@pytest.mark.parametrize("material", MATERIALS)
def test_exact_projections_contract_nothing(material: str) -> None:
    """In float64, whose quotients are an instruction: no product runs into a sum."""
    text = text_of(material, np.float64, "exact", damped=False)
    assert "fma.rn.f64" not in text and "mul.rn.f64" in text
