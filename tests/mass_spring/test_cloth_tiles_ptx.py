"""The cloth's kernel `resident` compiles without a GPU: no double in float32, nothing in local memory, one word a message."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_text import entry_of, record_of
from test_cloth_ptx import EVERYTHING, PLAIN, SPRINGS

FOUR = frozenset({"structural", "gravity"})


def text_of(tile: str, parts: frozenset[str], integrator: str, real: Any = np.float32, math: str = "fast") -> str:
    """The PTX of a kernel's body."""
    from numba import types

    from softlab.gpu_backend.core.tiling import parsed_tile
    from softlab.gpu_backend.mass_spring.cloth.resident import make_cloth_resident

    compiled = make_cloth_resident(real, math, integrator, parts, parsed_tile(tile))
    scalars = (types.float32 if real is np.float32 else types.float64)[::1]
    constants = (record_of(real, "quads"), scalars, types.uint64[::1], types.int64[::1])
    head = (scalars,) * 6 + (types.int32, types.int32[::1]) + constants + (types.int64,)
    signature = (*head, types.int32, types.int32)
    return entry_of(compiled.py_func, signature, math)


pytestmark = pytest.mark.usefixtures("ptx_compiler")


@pytest.mark.parametrize(
    "tile,parts,integrator,math",
    [
        ("8x4x2h1", EVERYTHING, "lab", "fast"),
        ("8x4x2h1", EVERYTHING, "lab", "exact"),
        ("16x4x4h1", PLAIN, "velocity-verlet", "fast"),
        ("16x16x1h2", PLAIN, "velocity-verlet", "fast"),
    ],
)
def test_float32_holds_no_double_and_no_local_memory(
    tile: str, parts: frozenset[str], integrator: str, math: str
) -> None:
    text = text_of(tile, parts, integrator, math=math)
    assert ".f64" not in text and ".local" not in text and "call" not in text
    assert ("fma." in text) == (math == "fast")
    assert "st.relaxed.gpu.global.b128" in text and "ld.relaxed.gpu.global.b128" in text


@pytest.mark.parametrize("real,words", [(np.float32, 1), (np.float64, 3)])
def test_a_mass_is_sent_in_as_few_words_as_carry_a_tag(real: Any, words: int) -> None:
    """Positions only, where no force asks for velocities and no tiles overlap; of 8 x 8 masses 64 threads fetch 80."""
    text = text_of("8x8x1h1", FOUR | SPRINGS, "lab", real)
    assert text.count("st.relaxed.gpu.global.b128") == words
    assert text.count("ld.relaxed.gpu.global.b128") == 2 * words
    assert ".local" not in text


def test_neighbours_are_read_once_for_a_strip() -> None:
    """Of a strip of four in the loop: its own column and two beyond either end, both next columns and one beyond, the two
    columns after those: 8 + 2 * 6 + 2 * 4 masses of three scalars; four masses are written at the kernel's end. Springs
    along the column are computed once for both ends: 4 structural ones and 1 above, 4 bending ones and 2 above, of 12 a
    mass."""
    text = text_of("16x4x4h1", SPRINGS, "lab")
    assert text.count("ld.shared.f32") == 3 * (8 + 12 + 8) + 3 * 4
    assert text.count("rsqrt") == 4 * 8 + (4 + 1) + (4 + 2)
    assert text.count("bar.sync") == 3  # one in the loop


def test_an_absent_part_leaves_no_instruction() -> None:
    bare, full = (text_of("8x4x2h1", parts, "lab") for parts in (FOUR, EVERYTHING))
    assert bare.count("rsqrt") == 2 * 2 + 2 + 1
    assert "3528531795" in full and "3528531795" not in bare  # the multiplier of the random generator
    assert bare.count("st.relaxed.gpu.global.b128") == 2 and full.count("st.relaxed.gpu.global.b128") == 4
