"""The scatters of bench/experiments/findings/scatter_gpu.py compile without a GPU, and hold the instructions that they are
there for."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_text import entry_of, record_of

pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_the_scatters_compile(real):
    """Atomics that return nothing (`red`), four to a spring; none in colours; no double in float32."""
    from numba import types

    from softlab.bench.experiments.findings.scatter_gpu import make_scatter

    kernels = make_scatter(real, "fast", frozenset({"springs", "gravity", "damping", "pins"}))
    pair = (types.complex64 if real is np.float32 else types.complex128)[::1]
    scalars = (types.float32 if real is np.float32 else types.float64)[::1]
    record = record_of(real, "grid")
    spring = (pair, scalars, record, types.int32, types.int32)
    move = (pair, pair, scalars, record, types.uint64[::1], types.int64[::1], types.int64, types.uint8[::1],
            types.uint8[::1], types.int32, types.int32)  # fmt: skip

    def text(kernel, signature):
        return entry_of(kernel.py_func, signature, "fast")

    atomic = text(kernels.atomics, spring)
    assert atomic.count("red.") + atomic.count("atom.") == 4
    others = [text(kernel, spring) for kernel in kernels.colours] + [text(kernels.move, move)]
    assert not any("red." in other or "atom." in other for other in others)
    if real is np.float32:
        assert not any(".f64" in code for code in (atomic, *others))
