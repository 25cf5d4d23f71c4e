"""The position-based solvers' CUDA kernels compile without a GPU where the compiler is there: no double in float32,
multipliers in registers, masses in vectors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of

KINDS = frozenset({"structural", "shear", "bending"})
SOFT = KINDS | {f"{kind}-compliance" for kind in KINDS} | {"damping", "gravity", "pins"}
EVERYTHING = (
    SOFT
    | {f"{kind}-damping" for kind in KINDS}
    | {"wind", "gust", "external", "poke", "plane", "sphere", "capsule", "box", "friction", "load", "attachments"}
)
GRID = frozenset({"structural", "structural-compliance", "alternating", "gravity", "pins", "external"})


pytestmark = pytest.mark.usefixtures("ptx_compiler")


def ptx(kernel: Any, arguments: str, real: Any, math: str) -> str:
    """The kernel's text. `arguments`, a letter each: f scalars, i 32-bit and l 64-bit integers of arrays, u the integer
    record, p that of reals, s a 32-bit integer, b a 64-bit one."""
    from numba import types

    kinds = {
        "f": (types.float32 if real is np.float32 else types.float64)[::1], "i": types.int32[::1],
        "l": types.int64[::1], "u": types.uint64[::1], "s": types.int32, "b": types.int64,
        "p": record_of(real, "quads"),
    }  # fmt: skip
    signature = tuple(kinds[letter] for letter in arguments)
    return entry_of(kernel.py_func, signature, math)


def assert_lean(text: str, real: Any = np.float32) -> None:
    assert ".local" not in text and "call" not in text
    assert real is np.float64 or ".f64" not in text


BLOCK = "ffifspfulbbbss"
TILED = "fffffffifspfulbbbssbss"


@pytest.mark.parametrize("ordering", ["gauss-seidel", "jacobi"])
def test_one_block_keeps_multipliers_in_registers(ordering: str) -> None:
    from softlab.gpu_backend.xpbd.tile import whole
    from softlab.gpu_backend.xpbd.tiled import make_one_block

    tile = whole(32, 32, 512)
    text = ptx(make_one_block(np.float32, "fast", SOFT | {ordering}, 3, tile), BLOCK, np.float32, "fast")
    assert_lean(text)
    assert "rsqrt.approx.ftz.f32" in text and "sqrt.rn" not in text
    assert "ld.shared.v4.f32" in text and "st.shared.v4.f32" in text
    assert "ld.shared.f32" not in text and "st.shared.f32" not in text
    if ordering == "gauss-seidel":
        assert text.count("bar.sync") == 12 + 2  # a colour each, and around the substep
        assert text.count("ld.shared.v4.f32") == 2 * 12 + 2  # both ends; the thread's masses at the end
    else:
        assert text.count("bar.sync") == 1 + 2 and text.count("ld.shared.v4.f32") == 13 * 2 + 2


@pytest.mark.parametrize(
    "ordering,parts", [("gauss-seidel", EVERYTHING), ("averaged-jacobi", SOFT | {"structural-damping", "attachments"})]
)
def test_tiles_of_many_parts(ordering: str, parts: frozenset[str]) -> None:
    from softlab.gpu_backend.xpbd.choice import cut
    from softlab.gpu_backend.xpbd.tiled import make_tiled

    parts = parts | {ordering}
    text = ptx(make_tiled(np.float32, "exact", parts, 3, cut(parts, (8, 8), 1)), TILED, np.float32, "exact")
    assert_lean(text)
    assert "fma." not in text and "approx" not in text and "mul.rn.f32" in text


def test_a_grid_is_projected_in_two_dimensions() -> None:
    """The third axis leaves no arithmetic: of a constraint two differences, a fused and a plain square and the four ends."""
    from softlab.gpu_backend.position_based.kernels import make_colour
    from softlab.model.position_based.plan import colour_order

    (family, colour), *_ = colour_order(GRID | {"gauss-seidel"})
    flat = frozenset({"structural", "gauss-seidel"})
    counts = []
    for axes in (2, 3):
        text = ptx(make_colour(np.float32, "fast", flat, family, colour, axes), "fffbspss", np.float32, "fast")
        assert_lean(text)
        counts.append(sum(text.count(f"{word}.ftz.f32") for word in ("add", "sub", "mul", "fma.rn")))
    assert counts[1] - counts[0] >= 4  # a difference, a square, its product with the scale, two ends


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_passes_hold_no_double_and_no_local_memory(real: Any) -> None:
    from softlab.gpu_backend.position_based.kernels import (
        make_attach,
        make_begin,
        make_colour,
        make_end,
        make_jacobi,
        make_plane_tools,
    )
    from softlab.model.position_based.plan import colour_order

    parts = (EVERYTHING if real is np.float32 else SOFT) | {"gauss-seidel"}
    rising = next(entry for entry in colour_order(parts) if entry[0].name == "rising")
    jacobi = GRID | {"jacobi"}
    for kernel, arguments in (
        (make_begin(real, "exact", parts, 3), "fffpulbbbss"),
        (make_colour(real, "exact", parts, *rising, 3), "fffbspss"),
        (make_jacobi(real, "exact", jacobi, 2), "ffffspss"),
        (make_attach(real, "exact"), "ffifs"),
        (make_end(real, "exact", parts, 3), "fffpfulbbb"),
    ):
        text = ptx(kernel, arguments, real, "exact")
        assert_lean(text, real)
        assert "fma." not in text and "approx" not in text
    from numba import types

    kind = types.float32 if real is np.float32 else types.float64
    write = make_plane_tools(real).write_position
    assert_lean(entry_of(write.py_func, (kind[::1], kind[:, ::1]), "exact"), real)


def test_stages_hold_no_double() -> None:
    from softlab.gpu_backend.core.forces import make_force_stages
    from softlab.gpu_backend.position_based.stages import make_xpbd_stages

    stage = make_xpbd_stages(np.float32, "fast", EVERYTHING | {"jacobi"}, 3)
    own = make_force_stages(np.float32, "fast", EVERYTHING | {"load"})
    for kernel, arguments in (
        (stage.wind, "ffpubfss"),
        *((kernel, "fpubf") for kernel in own.values()),
        (stage.predict, "ffffpss"),
        (stage.update_velocity, "fffp"),
        (stage.collide, "fffpfub"),
    ):
        assert_lean(ptx(kernel, arguments, np.float32, "fast"))
