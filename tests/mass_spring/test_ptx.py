"""Every CUDA kernel compiles without a GPU where the compiler is there, and float32 kernels hold no double."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, ptx_of, record_of

from softlab.model.core.parameters import PARAMETERS

pytestmark = pytest.mark.usefixtures("ptx_compiler")


def signature(kind: str, real: Any) -> tuple:
    from numba import types

    pair = (types.complex64 if real is np.float32 else types.complex128)[::1]
    tail = (
        record_of(real, "grid"), types.uint64[::1], types.int64[::1], types.int64, types.uint8[::1], types.uint8[::1],
        types.int32, types.int32,
    )  # fmt: skip
    return (pair,) * (4 if kind == "pass" else 8) + tail


def body(kernel: Any, kind: str, real: Any, math: str) -> str:
    return entry_of(kernel.py_func, signature(kind, real), math)


PARTS = frozenset({"springs", "gravity", "damping", "pins", "external", "poke"})


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet", "semi-implicit-euler", "explicit-euler", "taylor"])
def test_float32_passes_hold_no_double_and_spill_nothing(integrator: str, math: str) -> None:
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    for kernel in make_passes(np.float32, math, integrator, PARTS).values():
        text = body(kernel, "pass", np.float32, math)
        assert ".f64" not in text
        assert "ld.local" not in text and "st.local" not in text


def tile_text(kernel: Any, rung: str, real: Any, math: str) -> str:
    """The PTX of a kernel on tiles."""
    from numba import types

    pairs = (types.complex64 if real is np.float32 else types.complex128)[::1]
    constants = (record_of(real, "grid"), types.uint64[::1], types.int64[::1])
    tail = (types.int64, types.uint8[::1], types.int32, types.int32)
    flags = types.int32[::1]
    if rung == "resident":
        arguments = (*(pairs,) * 6, flags, types.int32, flags, *constants, *tail)
    else:
        arguments = (*(pairs,) * 4, *constants, types.int64, *tail, types.int32, types.int32)
    return ptx_of(kernel.py_func, arguments, math)


LAB_PARTS = frozenset({"springs", "gravity", "damping", "pins", "poke"})


def tile_kernel(
    rung: str, real: Any, math: str, integrator: str, tile: str, cut: bool = True, parts: frozenset[str] = PARTS
) -> Any:
    from softlab.gpu_backend.core.tiling import parsed_tile
    from softlab.gpu_backend.mass_spring.grid.resident import make_resident
    from softlab.gpu_backend.mass_spring.grid.tiles import make_tile_pass

    variant = (real, math, integrator, parts, parsed_tile(tile), cut)
    return make_resident(*variant) if rung == "resident" else make_tile_pass(*variant, rung == "one-block")


@pytest.mark.parametrize("math", ["fast", "exact"])
@pytest.mark.parametrize("integrator", ["lab", "velocity-verlet"])
@pytest.mark.parametrize("rung,tile", [("one-block", "32x32x1h0"), ("tiles", "64x8x8h4"), ("resident", "64x8x8h4")])
def test_float32_tiles_hold_no_double_and_keep_strips_in_registers(
    rung: str, tile: str, integrator: str, math: str
) -> None:
    """The random force makes the step of a mass so long that the compiler no longer unrolls a strip of 8."""
    with_random = tile_text(tile_kernel(rung, np.float32, math, integrator, tile), rung, np.float32, math)
    assert ".f64" not in with_random
    kernel = tile_kernel(rung, np.float32, math, integrator, tile, parts=LAB_PARTS)
    text = tile_text(kernel, rung, np.float32, math)
    assert ".f64" not in text
    assert ".local" not in text  # a strip's arrays are unrolled into registers
    assert "ld.shared.v2.f32" in text and "st.shared.v2.f32" in text and "bar.sync" in text
    assert (
        "ld.shared.f32" not in text and "ld.global.f32" not in text.split("bar.sync", 1)[1]
    )  # pairs, and constants once


@pytest.mark.parametrize("real,word", [(np.float32, "f32"), (np.float64, "f64")])
def test_resident_blocks_speak_through_release_and_acquire(real: Any, word: str) -> None:
    text = tile_text(tile_kernel("resident", real, "fast", "lab", "32x8x4h4"), "resident", real, "fast")
    assert "st.release.gpu.global.s32" in text and "ld.acquire.gpu.global.s32" in text
    assert f"ld.relaxed.gpu.global.v2.{word}" in text  # borders pass by the first-level cache


@pytest.mark.parametrize("rung", ["one-block", "tiles", "resident"])
def test_a_tile_computes_each_vertical_spring_once(rung: str) -> None:
    """A strip of n masses has n + 1 springs above and below and 2 n to the sides: 3 n + 1 roots a step, not 4 n."""
    tile = "32x4x8h0" if rung == "one-block" else "32x4x8h4"
    text = tile_text(tile_kernel(rung, np.float32, "fast", "lab", tile, cut=False), rung, np.float32, "fast")
    assert text.count("rsqrt.approx") == 3 * 8 + 1


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("rung", ["tiles", "resident"])
def test_exact_tiles_contract_nothing(rung: str, real: Any) -> None:
    text = tile_text(tile_kernel(rung, real, "exact", "lab", "32x4x4h4"), rung, real, "exact")
    assert "fma." not in text and "approx" not in text


def test_fast_float64_needs_no_branch_for_a_root() -> None:
    """20 bits from the hardware and one step of arithmetic, where the library's root checks for special numbers."""
    text = tile_text(tile_kernel("tiles", np.float64, "fast", "lab", "32x4x4h4", False), "tiles", np.float64, "fast")
    assert text.count("rsqrt.approx.ftz.f64") == 3 * 4 + 1
    assert "sqrt.rn" not in text


@pytest.mark.parametrize("math", ["fast", "exact"])
def test_float32_stages_of_rk4_hold_no_double(math: str) -> None:
    from softlab.gpu_backend.mass_spring.grid.kernels import make_rk4_stages

    for kernel in make_rk4_stages(np.float32, math, PARTS):
        assert ".f64" not in body(kernel, "rk4", np.float32, math)


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_exact_math_contracts_nothing(real: Any) -> None:
    """No fused multiply-add, and roots and quotients rounded to nearest. (float64's are expanded later, by ptxas.)"""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    for kernel in make_passes(real, "exact", "velocity-verlet", PARTS).values():
        text = body(kernel, "pass", real, "exact")
        assert "fma." not in text and "approx" not in text
        assert f"mul.rn.{'f32' if real is np.float32 else 'f64'}" in text


def test_fast_math_uses_the_reciprocal_root_and_keeps_the_subtraction() -> None:
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    text = body(make_passes(np.float32, "fast", "lab", PARTS)["step"], "pass", np.float32, "fast")
    assert "rsqrt.approx" in text and "sqrt.rn" not in text
    assert text.count("sub.rn") >= 2  # (p' - p) of the hand-out's step, once an axis


@pytest.mark.parametrize("real,word", [(np.float32, "f32"), (np.float64, "f64")])
def test_both_axes_come_in_one_load(real: Any, word: str) -> None:
    """Four neighbours, the mass itself and its velocity: six loads of a pair; two stores. The rest are constants."""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    text = body(make_passes(real, "fast", "lab", frozenset({"springs"}))["step"], "pass", real, "fast")
    assert text.count(f"ld.global.v2.{word}") == 6
    assert text.count(f"st.global.v2.{word}") == 2
    assert f"st.global.{word}" not in text


def test_an_absent_part_leaves_no_instruction() -> None:
    """Without the random force there is no integer multiplication to 64 bits; without springs no root."""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    with_all = body(make_passes(np.float32, "fast", "lab", PARTS)["step"], "pass", np.float32, "fast")
    bare = body(make_passes(np.float32, "fast", "lab", frozenset())["step"], "pass", np.float32, "fast")
    assert "rsqrt" in with_all and "rsqrt" not in bare
    assert "3528531795" in with_all and "3528531795" not in bare  # the multiplier of the random generator
    loads = [text.count("ld.global") for text in (with_all, bare)]
    assert loads[1] == 4  # position and velocity, and the two constants of the step: nothing else is read
    assert loads[0] > 12


@pytest.mark.parametrize("real,word,size", [(np.float32, "f32", 4), (np.float64, "f64", 8)])
def test_alternating_springs_read_two_constants_more_and_equal_ones_do_not(real: Any, word: str, size: int) -> None:
    """Parity picks the place in the record that a spring's two constants are read from: four springs, no branch, still six
    loads of a pair; float32 stays float32, exact math stays uncontracted."""
    from softlab.gpu_backend.mass_spring.grid.kernels import make_passes

    stiff, stiffness, stiff_rest, stiffness_rest = (
        PARAMETERS.index(name) * size for name in ("stiff", "stiffness", "stiff_rest", "stiffness_rest")
    )
    places = {frozenset({stiff, stiffness}), frozenset({stiff_rest, stiffness_rest})}
    last = f"+{stiff}]", f"+{stiff_rest}]"
    for math in ("fast", "exact"):
        equal = body(make_passes(real, math, "lab", PARTS)["step"], "pass", real, math)
        uneven = body(make_passes(real, math, "lab", PARTS | {"alternating"})["step"], "pass", real, math)
        address = {name: int(offset) for name, offset in re.findall(r"add\.s64\s+(%rd\d+), %rd\d+, (\d+);", uneven)}
        choices = re.findall(r"selp\.b64\s+\S+ (%rd\d+), (%rd\d+),", uneven)
        picked = [frozenset(address.get(name, 0) for name in pair) for pair in choices]
        assert places <= set(picked)  # how often depends on what the compiler reuses
        assert not re.search(r"selp\.b64\s+\S+ %rd\d+, %rd\d+,", equal) and not any(place in equal for place in last)
        assert uneven.count(f"ld.global.v2.{word}") == equal.count(f"ld.global.v2.{word}") == 6
        assert "ld.local" not in uneven and (word == "f64" or ".f64" not in uneven)
        assert math == "fast" or ("fma." not in uneven and "approx" not in uneven)


@pytest.mark.parametrize("real,word", [(np.float32, "f32"), (np.float64, "f64")])
def test_the_arithmetic_rate_is_one_of_fused_multiply_adds(real: Any, word: str) -> None:
    """Nothing but fused products and sums in the loop, in registers, and in float32 no double."""
    from numba import types

    from softlab.gpu_backend.core.arithmetic import NUMBERS, UNROLLED, make_chains

    scalar = types.float32 if real is np.float32 else types.float64
    kernel = make_chains(real).py_func
    text = entry_of(kernel, (scalar[::1], types.int32, scalar, scalar), "fast")
    assert text.count("fma.rn") >= NUMBERS * UNROLLED
    assert "ld.local" not in text and "st.local" not in text
    assert word == "f64" or ".f64" not in text
