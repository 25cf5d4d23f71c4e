"""Implicit Euler's CUDA kernel compiles without a GPU where the compiler is there: no double in float32, no local memory."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import entry_of, record_of

SPRINGS = frozenset({"structural", "shear", "bending"})
AIR = frozenset({"wind", "gust", "external", "poke", "gravity", "pins", "motion"})
BODIES = frozenset({"plane", "sphere", "capsule", "box", "friction"})
EVERYTHING = SPRINGS | {f"{kind}-damping" for kind in SPRINGS} | AIR | BODIES | {"damping"}

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("parts", [SPRINGS | {"gravity", "pins"}, EVERYTHING], ids=["springs", "everything"])
def test_float32_holds_no_double_and_no_local_memory(parts, math) -> None:
    from numba import types

    from softlab.gpu_backend.mass_spring.cloth.implicit import make_cloth_implicit

    quads, count = types.float32[::1], types.int64[::1]
    records = record_of(np.float32, "quads"), record_of(np.float32, "matrix")
    signature = (
        *(quads,) * 12, types.int32[::1], count, *records, quads, types.uint64[::1], count, types.int64, types.int32,
        types.int32,
    )  # fmt: skip
    kernel = make_cloth_implicit(np.float32, math, False, parts)
    text = entry_of(kernel.py_func, signature, math)
    assert ".f64" not in text
    assert ".local" not in text and "call" not in text
