"""Every CUDA kernel compiles without a GPU where the compiler is there, and float32 kernels hold no double."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Needs NVVM and NVRTC: pip install -e ".[ptx]"."""
    cuda = pytest.importorskip("numba.cuda", reason="needs numba-cuda")
    import numba.cuda.dispatcher as dispatcher
    from numba import types

    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
    try:
        cuda.compile_ptx(lambda a: None, (types.float32[::1],), cc=(9, 0))
    except Exception as error:
        pytest.skip(f'the CUDA compiler is not installed (pip install -e ".[ptx]"): {type(error).__name__}')


def signature(kind: str, real: Any) -> tuple:
    from numba import types

    pair = (types.complex64 if real is np.float32 else types.complex128)[::1]
    scalar = (types.float32 if real is np.float32 else types.float64)[::1]
    tail = (
        scalar, types.uint64[::1], types.int64[::1], types.int64, types.uint8[::1], types.uint8[::1], types.int32,
        types.int32,
    )  # fmt: skip
    return (pair,) * (4 if kind == "pass" else 8) + tail


def body(kernel: Any, kind: str, real: Any, math: str) -> str:
    from numba import cuda

    text, _ = cuda.compile_ptx(kernel.py_func, signature(kind, real), cc=(9, 0), fastmath=math == "fast")
    return text[text.index(".entry") :]


PARTS = frozenset({"springs", "gravity", "damping", "pins", "external", "poke"})


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "semi-implicit-euler", "explicit-euler", "taylor"])
def test_float32_passes_hold_no_double_and_spill_nothing(integrator: str, math: str) -> None:
    from gpu_backend.mass_spring_kernels import make_passes

    for kernel in make_passes(np.float32, math, integrator, PARTS).values():
        text = body(kernel, "pass", np.float32, math)
        assert ".f64" not in text
        assert "ld.local" not in text and "st.local" not in text


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
def test_the_float32_block_holds_no_double(integrator: str, math: str) -> None:
    from numba import cuda, types

    from gpu_backend.one_block import make_one_block

    kernel = make_one_block(np.float32, math, integrator, PARTS)
    pairs, scalars = types.complex64[::1], types.float32[::1]
    arguments = (
        pairs, pairs, scalars, types.uint64[::1], types.int64[::1], types.int64, types.uint8[::1], types.int32, types.int32,
    )  # fmt: skip
    text, _ = cuda.compile_ptx(kernel.py_func, arguments, cc=(9, 0), fastmath=math == "fast")
    assert ".f64" not in text
    assert "ld.local" not in text
    assert "ld.shared.v2.f32" in text and "bar.sync" in text


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_stages_of_rk4_hold_no_double(math: str) -> None:
    from gpu_backend.mass_spring_kernels import make_rk4_stages

    for kernel in make_rk4_stages(np.float32, math, PARTS):
        assert ".f64" not in body(kernel, "rk4", np.float32, math)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_exact_math_contracts_nothing(real: Any) -> None:
    """No fused multiply-add, and roots and quotients rounded to nearest. (float64's are expanded later, by ptxas.)"""
    from gpu_backend.mass_spring_kernels import make_passes

    for kernel in make_passes(real, "exact", "velocity-verlet", PARTS).values():
        text = body(kernel, "pass", real, "exact")
        assert "fma." not in text and "approx" not in text
        assert f"mul.rn.{'f32' if real is np.float32 else 'f64'}" in text


def test_fast_math_uses_the_reciprocal_root_and_keeps_the_subtraction() -> None:
    from gpu_backend.mass_spring_kernels import make_passes

    text = body(make_passes(np.float32, "fast", "lab", PARTS)["step"], "pass", np.float32, "fast")
    assert "rsqrt.approx" in text and "sqrt.rn" not in text
    assert text.count("sub.rn") >= 2  # (p' - p) of the hand-out's step, once an axis


@pytest.mark.parametrize("real,word", [(np.float32, "f32"), (np.float64, "f64")])
def test_both_axes_come_in_one_load(real: Any, word: str) -> None:
    """Four neighbours, the mass itself and its velocity: six loads of a pair; two stores. The rest are constants."""
    from gpu_backend.mass_spring_kernels import make_passes

    text = body(make_passes(real, "fast", "lab", frozenset({"springs"}))["step"], "pass", real, "fast")
    assert text.count(f"ld.global.v2.{word}") == 6
    assert text.count(f"st.global.v2.{word}") == 2
    assert f"st.global.{word}" not in text


def test_an_absent_part_leaves_no_instruction() -> None:
    """Without the random force there is no integer multiplication to 64 bits; without springs no root."""
    from gpu_backend.mass_spring_kernels import make_passes

    with_all = body(make_passes(np.float32, "fast", "lab", PARTS)["step"], "pass", np.float32, "fast")
    bare = body(make_passes(np.float32, "fast", "lab", frozenset())["step"], "pass", np.float32, "fast")
    assert "rsqrt" in with_all and "rsqrt" not in bare
    assert "3528531795" in with_all and "3528531795" not in bare  # the multiplier of the random generator
    loads = [text.count("ld.global") for text in (with_all, bare)]
    assert loads[1] == 4  # position and velocity, and the two constants of the step: nothing else is read
    assert loads[0] > 12
